"""The grasps of this folder, one line each: what the page lists, counts and gives as a table."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, date, datetime
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.dashboard.live import Point
from palpate.dashboard.messages import Grasped
from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.files import csv_cell
from palpate.grasp.verdict import verdict

#: Number of grasps that the page lists.
LISTED = 50
#: Number of points of a small curve.
_POINTS = 48
_FILE = "grasps.jsonl"
#: Grasps of a table that are made at a time.
_ROWS = 200
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
    #: Where the rules put it, whether only until another grasp, and why; None without rules.
    bin: str | None = None
    again: bool | None = None
    why: str | None = None
    #: Stage of ripeness and bruise by the item's last verdicts; None where there are none.
    stage: str | None = None
    bruised: bool | None = None
    #: Values and ends of their intervals, by name with its unit; None for what is not known.
    measured: dict[str, float | None]
    #: The course of the force (newtons), or of the reading (percent) where it is not calibrated.
    curve: tuple[float, ...] = ()


_FIELDS = frozenset(field.name for field in fields(Entry))


class Summary(NamedTuple):
    """A grasp as the list of recordings shows it."""

    outcome: str
    item_id: str
    simulated: bool


class History:
    """Keeps the grasps in a file of the folder, and the last of them in mind.

    The file is only ever appended to: a grasp is a line, and so is the new name of a recording.

    Parameters
    ----------
    folder : Path
        Where recordings go.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / _FILE
        #: Name of each renamed recording now, by the name that its grasp is kept under.
        self._names = dict[str, str]()
        self._of_recording = dict[str, Summary]()
        self._recent = deque[Entry](maxlen=LISTED)
        #: How the grasps of the last day with any ended.
        self._day, self._of_day = date.min, Counter[str]()
        for stated in self._state_entry():
            if "renamed" in stated:
                self._follow(str(stated["recording"]), str(stated["renamed"]))
            elif (entry := _entry(stated)) is not None:
                self._take(entry)
        self._of_this_run: list[tuple[str, str | None]] = []
        #: Since when this run counts.
        self.since = datetime.now(UTC)
        #: Grows with every change.
        self.version = 0

    @property
    def recent(self) -> list[Entry]:
        """The last grasps, the newest first."""
        return list(reversed(self._recent))

    def of(self, recording: str) -> Summary | None:
        """Return the grasp of a recording; None where it holds none, or none that was kept."""
        return self._of_recording.get(recording)

    @property
    def outcomes(self) -> Counter[str]:
        """How the grasps of this run ended."""
        return Counter(outcome for outcome, _ in self._of_this_run)

    @property
    def bins(self) -> Counter[str]:
        """How many of this run went to each bin."""
        return Counter(found for _, found in self._of_this_run if found is not None)

    def glance(self) -> list[str]:
        """Return the last grasp and the counts of today in words; nothing before the first."""
        if not self._recent:
            return []
        last = self._recent[-1]
        when = datetime.fromisoformat(last.ended_at).astimezone()
        ended = ", ".join(filter(None, (last.outcome.replace("_", " "), last.firmness)))
        words = [f"last grasp {when:%d %b %H:%M}: {' '.join(filter(None, (last.item_id, ended)))}"]
        if self._day == datetime.now().date():
            counts = self._of_day.most_common()
            words.append(
                "today " + ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts)
            )
        return words

    def add(self, entry: Entry) -> None:
        """Keep a grasp.

        Raises
        ------
        OSError
            If the file can't be written; the page lists the grasp nevertheless.
        """
        self._take(entry)
        self._of_this_run.append((entry.outcome, entry.bin))
        self.version += 1
        self._append(asdict(entry))

    def rename(self, before: str, after: str) -> None:
        """Let a recording have another name.

        Raises
        ------
        OSError
            If the file can't be written; it is then as it was.
        """
        if before in self._of_recording:
            self._append({"recording": before, "renamed": after})
            self._follow(before, after)
            self.version += 1

    def csv_parts(self) -> Iterator[str]:
        """Yield a table of every grasp of the folder; the names of columns end in their units."""
        columns = ["ended_at", "item_id", "outcome", "verdict", "firmness", "damaged", "bin", "why"]
        columns += ["stage", "bruised"]
        columns += [name + end for name in _MEASURED for end in ("", "_low", "_high")]
        columns += ["decision_time_s", "recording", "simulated"]
        yield _csv_text(columns, [dict(zip(columns, columns, strict=True))])
        entries = (entry for stated in self._state_entry() if (entry := _entry(stated)) is not None)
        while part := list(islice(entries, _ROWS)):
            rows = [self._row(entry) for entry in part]
            yield _csv_text(columns, rows)

    def _take(self, entry: Entry) -> None:
        self._recent.append(entry)
        day = datetime.fromisoformat(entry.ended_at).astimezone().date()
        if day != self._day:
            self._day, self._of_day = day, Counter()
        self._of_day[entry.outcome] += 1
        if entry.recording:
            summary = Summary(entry.outcome, entry.item_id, entry.simulated)
            self._of_recording[entry.recording] = summary

    def _follow(self, before: str, after: str) -> None:
        """Know a recording by its new name."""
        for first, name in list(self._names.items()):
            if name == before:
                self._names[first] = after
        self._names.setdefault(before, after)
        summary = self._of_recording.pop(before, None)
        if summary is not None:
            self._of_recording[after] = summary
        renamed = [
            replace(one, recording=after) if one.recording == before else one
            for one in self._recent
        ]
        self._recent = deque(renamed, maxlen=LISTED)

    def _row(self, entry: Entry) -> dict[str, Any]:
        recording = self._names.get(entry.recording, entry.recording)
        cells = {**asdict(entry), **entry.measured, "recording": recording}
        return {name: csv_cell(value) for name, value in cells.items()}

    def _append(self, stated: dict[str, Any]) -> None:
        """Add a line; a line that was cut off, by a full disk or a power cut, spoils no other."""
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("ab+", buffering=0) as lines:
            end = lines.seek(0, os.SEEK_END)
            cut = end > 0 and os.pread(lines.fileno(), 1, end - 1) != b"\n"
            line = ("\n" if cut else "") + json.dumps(stated) + "\n"
            if lines.write(line.encode()) < len(line.encode()):
                lines.truncate(end)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._file))

    def _state_entry(self) -> Iterator[dict[str, Any]]:
        """Yield what each line states, oldest first; a line that was cut off states nothing."""
        with suppress(OSError), self._file.open(encoding="utf-8", errors="replace") as lines:
            for line in lines:
                with suppress(ValueError):
                    stated = json.loads(line)
                    if isinstance(stated, dict):
                        yield stated


def _entry(stated: dict[str, Any]) -> Entry | None:
    known = {name: value for name, value in stated.items() if name in _FIELDS}
    try:
        entry = Entry(**known | {"curve": tuple(known.get("curve", ()))})
        datetime.fromisoformat(entry.ended_at)
    except (TypeError, ValueError):
        return None
    return entry


def _csv_text(columns: Sequence[str], rows: Iterable[dict[str, Any]]) -> str:
    text = io.StringIO()
    csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n").writerows(rows)
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
        ended_at=datetime.now(UTC).isoformat(timespec="milliseconds"),
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


def check_name(stem: str) -> str:
    """Return the name of a recording as a file may have it.

    Raises
    ------
    InputError
        If it could lead out of the folder, or hide the file.

    Examples
    --------
    >>> check_name("monday 3")
    'monday 3.mcap'
    >>> check_name("../monday")
    Traceback (most recent call last):
    palpate.errors.InputError: '../monday': letters, digits, spaces, - and _ make a name
    """
    stem = stem.strip()
    usable = all(letter.isalnum() or letter in " -_." for letter in stem)
    if not stem or len(stem) > 80 or stem.startswith(".") or not usable:
        raise InputError(f"{stem!r}: letters, digits, spaces, - and _ make a name")
    return f"{stem}.mcap"
