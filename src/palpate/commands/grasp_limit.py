"""`palpate grasp --damage`: the learned limit of the object, and what it did."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.estimate.damage_file import DamageFile
    from palpate.grasp.result import GraspResult
    from palpate.grasp.state import GraspState


class Limit:
    """The damage model of one grasp; it follows the limit over the closing."""

    def __init__(self, file: DamageFile, *, path: Path, kind: str) -> None:
        self.model = file.model
        self.kind = kind
        self.text = file.as_text()
        self._file = file
        self._path = path
        self._low_n = math.inf

    def see(self, grasp_state: GraspState) -> None:
        """Take the controller's next grasp_state."""
        self._low_n = grasp_state.estimate.damage_low_n

    def to_dict(self, result: GraspResult) -> dict[str, object]:
        """Return what the limit was and did, as in the JSON of the grasp."""
        from palpate.grasp.document import limit_document

        return limit_document(
            self._file, path=self._path, kind=self.kind, low_n=self._low_n, result=result
        )


def open_limit(path: Path | None, *, kind: str | None) -> Limit | None:
    """Return the limit that a user asks for, None for none.

    Raises `InputError` if a kind is given without a file, or is not in it; `CalibrationError` if
    the file can't be used.
    """
    from palpate.estimate.damage_file import DamageFile

    if path is None:
        if kind is not None:
            raise InputError(f"--kind {kind}: give --damage FILE too, which knows kinds")
        return None
    file = DamageFile.load(path)
    known = "" if kind is None else file.known_kind(kind, where=f"--damage {path}")
    return Limit(file, path=path, kind=known)


def limit_text(limit: Mapping[str, object]) -> str:
    """Return what the limit was and did, in a line for the card."""
    who = limit["kind"] or "unknown kind"
    learned = f"{who}, {limit['closings']} closings"
    if limit["low_n"] is None:
        why = "not shown by this closing, so the hand closed only a little further"
        return f"Damage limit ({learned}): {why}"
    did = ""
    if limit["passed"]:
        # A sheet that does not feel a faint force shows the limit only once it is passed.
        did = ": shown only once the force had passed it; nothing more was pressed"
    elif limit["kept_below_target"]:
        did = ": it kept the force below what was asked for"
    return f"Damage limit {limit['low_n']:.1f} N ({learned}){did}"
