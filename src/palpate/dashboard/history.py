"""The grasps of this folder, one line each: what the page lists, counts and gives as a table."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from palpate.dashboard.language import Message
from palpate.dashboard.live import Point
from palpate.dashboard.messages import Grasped
from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.grasp.verdict import verdict

#: Number of grasps that the page lists.
LISTED = 50
#: Number of points of a small curve.
_POINTS = 48
_FILE = "grasps.jsonl"
_MEASURED = ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One grasp."""

    #: When it ended, in UTC.
    ended_at: str
    #: Name of the recording.
    recording: str
    #: Whether any of it was simulated.
    simulated: bool
    #: What it was; empty where it had no name.
    item_id: str
    #: How it ended.
    outcome: str
    #: The same in words, and how firm the object was.
    verdict: str
    firmness: str | None
    #: ``"good"``, ``"warn"`` or ``"bad"``, as the page colours it.
    kind: str
    #: Whether the object was damaged, as simulated rigs know; None on real ones.
    damaged: bool | None = None
    #: Where the rules put it, and why; None where no rules were given.
    bin: str | None = None
    why: str | None = None
    #: Values and ends of their intervals, by name with its unit; None for what is not known.
    measured: dict[str, float | None]
    #: The course of the force (newtons), or of the reading (percent) where it is not calibrated.
    curve: tuple[float, ...] = ()


class History:
    """Keeps the grasps in a file of the folder, and the last of them in mind.

    Parameters
    ----------
    folder : Path
        Where recordings go.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / _FILE
        self._recent: deque[Entry] = deque(self.all(), maxlen=LISTED)
        self._of_this_run: list[tuple[str, str | None]] = []
        #: Since when this run counts.
        self.since = datetime.now(UTC)
        #: Grows with every change.
        self.version = 0
        self._indexed, self._by_recording = -1, dict[str, Entry]()

    @property
    def recent(self) -> list[Entry]:
        """The last grasps, the newest first."""
        return list(reversed(self._recent))

    def of(self, recording: str) -> Entry | None:
        """Return the grasp of a recording; None where it holds none, or none that was kept."""
        if self._indexed != self.version:
            self._by_recording = {entry.recording: entry for entry in self.all()}
            self._indexed = self.version
        return self._by_recording.get(recording)

    @property
    def outcomes(self) -> Counter[str]:
        """How the grasps of this run ended."""
        return Counter(outcome for outcome, _ in self._of_this_run)

    @property
    def bins(self) -> Counter[str]:
        """How many of this run went to each bin."""
        return Counter(found for _, found in self._of_this_run if found is not None)

    def add(self, entry: Entry) -> None:
        """Keep a grasp.

        Raises
        ------
        OSError
            If the file can't be written; the page lists the grasp nevertheless.
        """
        self._recent.append(entry)
        self._of_this_run.append((entry.outcome, entry.bin))
        self.version += 1
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(asdict(entry)) + "\n")

    def rename(self, before: str, after: str) -> None:
        """Let a recording have another name.

        Raises
        ------
        OSError
            If the file can't be written.
        """
        entries = [
            replace(one, recording=after) if one.recording == before else one for one in self.all()
        ]
        text = "".join(json.dumps(asdict(one)) + "\n" for one in entries)
        if entries:
            self._file.write_text(text, encoding="utf-8")
        self._recent = deque(entries, maxlen=LISTED)
        self.version += 1

    def all(self) -> Iterator[Entry]:
        """Yield every grasp kept in the folder, oldest first; a line cut off is no grasp."""
        names = {field.name for field in fields(Entry)}
        with suppress(OSError), self._file.open(encoding="utf-8") as lines:
            for line in lines:
                with suppress(ValueError, TypeError, AttributeError):
                    stated: dict[str, Any] = json.loads(line)
                    known = {name: value for name, value in stated.items() if name in names}
                    yield Entry(**known | {"curve": tuple(known.get("curve", ()))})

    def as_csv(self) -> str:
        """Return every grasp of the folder as a table; the names of columns end in their units."""
        columns = ["ended_at", "item_id", "outcome", "verdict", "firmness", "damaged", "bin", "why"]
        columns += [name + end for name in _MEASURED for end in ("", "_low", "_high")]
        columns += ["decision_time_s", "recording", "simulated"]
        text = io.StringIO()
        table = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        for entry in self.all():
            table.writerow({**asdict(entry), **entry.measured})
        return text.getvalue()


def entry_of(
    grasped: Grasped,
    *,
    kind: str,
    item_id: str,
    target_force_n: float | None,
    simulated: bool,
    curve: Sequence[Point],
) -> Entry:
    """Return the entry of a grasp that has just ended; `curve` as it was drawn."""
    result, words = grasped.result, verdict(grasped.result, target_force_n=target_force_n)
    measured: dict[str, float | None] = {"decision_time_s": result.decision_time_s}
    for name in _MEASURED:
        measured |= _ends(name, getattr(result, name))
    firmness = words["firmness"]
    return Entry(
        ended_at=datetime.now(UTC).isoformat(timespec="seconds"),
        recording="" if grasped.recording is None else grasped.recording.name,
        simulated=simulated,
        item_id=item_id,
        outcome=str(result.outcome),
        verdict=str(words["text"]),
        damaged=None if grasped.truth is None else bool(grasped.truth.get("damaged")),
        firmness=None if firmness is None else str(firmness),
        kind=kind,
        measured=measured,
        curve=_small(curve),
    )


def _ends(name: str, one: Measurement | None) -> dict[str, float | None]:
    if one is None:
        return {}
    low, high = one.known_ends
    return {name: one.value if one.number else None, f"{name}_low": low, f"{name}_high": high}


def _small(curve: Sequence[Point]) -> tuple[float, ...]:
    """Return some points of a curve, evenly in time."""
    if len(curve) < 2:
        return ()
    forces = [(one.time_s, one.force.value) for one in curve if one.force is not None]
    time_s, values = zip(*(forces or [(one.time_s, one.percent) for one in curve]), strict=True)
    at_s = np.linspace(time_s[0], time_s[-1], _POINTS)
    return tuple(round(float(value), 2) for value in np.interp(at_s, time_s, values))


def checked_name(stem: str) -> str:
    """Return the name of a recording as a file may have it.

    Raises
    ------
    InputError
        If it could lead out of the folder, or hide the file.

    Examples
    --------
    >>> checked_name("monday 3")
    'monday 3.mcap'
    >>> checked_name("../monday")
    Traceback (most recent call last):
    palpate.errors.InputError: '../monday': letters, digits, spaces, - and _ make a name
    """
    stem = stem.strip()
    usable = all(letter.isalnum() or letter in " -_." for letter in stem)
    if not stem or len(stem) > 80 or stem.startswith(".") or not usable:
        raise InputError(
            Message("{stem!r}: letters, digits, spaces, - and _ make a name", stem=stem)
        )
    return f"{stem}.mcap"
