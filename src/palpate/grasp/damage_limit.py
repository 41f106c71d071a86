"""A learned damage limit that a grasp obeys, and its effect on the grasp."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from palpate.errors import InputError
from palpate.grasp.result import GraspResult
from palpate.object.damage_file import DamageFile


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageLimit:
    """A damage file, and the kind of the object.

    Attributes
    ----------
    file : DamageFile
        The learned model and its training set.
    path : str
        Where the file was read.
    kind : str
        Kind of produce in the file; empty if unknown.
    """

    file: DamageFile
    path: str
    kind: str = ""

    def to_dict(self, result: GraspResult, *, low_n: float) -> dict[str, object]:
        """Return the JSON form of the limit and its effect on a grasp.

        `low_n`: limit of this object, newtons; infinite if the closing did not determine it.
        """
        is_known = math.isfinite(low_n)
        closings = self.file.closings
        return {
            "file": self.path,
            "kind": self.kind or None,
            "closings": closings[self.kind] if self.kind else sum(closings.values()),
            "rate": self.file.model.rate,
            "low_n": low_n if is_known else None,
            "passed": is_known and (result.peak_force_n or 0.0) > low_n,
            "kept_below_target": result.is_limited,
        }


def load_limit(
    path: str | os.PathLike[str] | None,
    *,
    kind: str | None,
    names: Mapping[str, str] = MappingProxyType({}),
) -> DamageLimit | None:
    """Load a damage file and choose the kind; return None without a file.

    `names`: what messages call `damage` and `kind`.
    Raises `CalibrationError` if the file is unusable, and `InputError` as `choose_limit` does.
    """
    file = None if path is None else DamageFile.load(Path(path))
    return choose_limit(file, path=path, kind=kind, names=names)


def choose_limit(
    file: DamageFile | None,
    *,
    path: str | os.PathLike[str] | None,
    kind: str | None,
    names: Mapping[str, str] = MappingProxyType({}),
) -> DamageLimit | None:
    """Return the limit of a loaded file for a kind of object; None without a file.

    `path`: where the file was read. `names`: what messages call `damage` and `kind`.
    Raises `InputError` if a kind is given without a file, or the file lacks the kind.

    >>> choose_limit(None, path=None, kind="kiwi")
    Traceback (most recent call last):
    palpate.errors.InputError: kind kiwi: requires damage=FILE, which defines the kinds
    """
    if file is None:
        if kind is None:
            return None
        given, needed = names.get("kind", "kind"), names.get("damage", "damage=FILE")
        raise InputError(f"{given} {kind}: requires {needed}, which defines the kinds")
    known = "" if kind is None else file.check_kind(kind, where=f"the damage file {path}")
    return DamageLimit(file=file, path=str(path), kind=known)
