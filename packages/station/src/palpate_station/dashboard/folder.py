"""The folder of recordings: its files, and the history of its grasps."""

from __future__ import annotations

import csv
import errno
import heapq
import io
import json
import math
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, date, datetime
from functools import lru_cache
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from palpate.errors import InputError, PalpateError
from palpate.files import escape_csv_cell
from palpate.grasp.result import Outcome
from palpate.grasp.verdict import verdict
from palpate.measurement import Measurement
from palpate.recording import RecordingReader
from palpate_station.dashboard.live import Point
from palpate_station.dashboard.lot import GivenBins, Lot
from palpate_station.dashboard.messages import Grasped, GraspOrder
from palpate_station.records import BIN_COLUMNS, Source

#: Number of grasps that the page lists.
LISTED_GRASPS = 50
#: Number of points of a stored force curve.
_CURVE_POINTS = 48
_FILE, _SUFFIX = "grasps.jsonl", ".mcap"
#: Maximum length of a missing name in a message.
_MAX_SHOWN_NAME = 80
#: Number of table rows written per chunk.
_CSV_CHUNK_ROWS = 200
_MEASUREMENTS = ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One grasp of the history."""

    #: End time in UTC.
    ended_at: str
    #: Name of the recording.
    recording: str
    #: Whether any of the data is simulated.
    simulated: bool
    #: Name of the item; empty without a name.
    item_id: str
    #: Outcome of the grasp.
    outcome: str
    #: Text of the outcome, and firmness of the object.
    verdict: str
    firmness: str | None
    #: Colour on the page: ``"good"``, ``"warn"`` or ``"bad"``.
    kind: str
    #: Whether the object was damaged, on simulated rigs; None on real rigs.
    damaged: bool | None = None
    #: Bin, whether it is provisional until another grasp, and the reason; None without rules.
    bin: str | None = None
    again: bool | None = None
    why: str | None = None
    #: Probability that all conditions of the bin's rule are met.
    probability: float | None = None
    #: Ripeness stage and bruise according to the item's last verdicts; None without verdicts.
    stage: str | None = None
    bruised: bool | None = None
    #: Whether a named item is in the store, and its batch there; None if unknown.
    stored: bool | None = None
    batch: str | None = None
    #: Values and interval limits by name with unit; None if unknown.
    measured: dict[str, float | None]
    #: Force over time (newtons), or relative change (percent) without a force calibration.
    curve: tuple[float, ...] = ()


_FIELDS = frozenset(field.name for field in fields(Entry))


class GraspSummary(NamedTuple):
    """The data of a grasp in the list of recordings."""

    outcome: str
    item_id: str
    simulated: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Interruption:
    """A grasp that began and was cut off by the end of a process, so that nothing was stored."""

    #: Name of the item; empty without a name.
    item_id: str
    #: Name of the recording, which ends with the interruption.
    recording: str
    #: Start of the grasp in UTC.
    began_at: str


class History:
    """The history of grasps: all in a file, the newest in memory.

    The file is append-only. Each start and each end of a grasp, each renaming of a recording and
    each start of a lot is one line.

    Parameters
    ----------
    folder : Path
        Folder of the recordings.
    default_bin : str, optional
        The bin of the items that no rule accepts; None without rules.
    """

    def __init__(self, folder: Path, *, default_bin: str | None = None) -> None:
        self._file, self._default_bin = folder / _FILE, default_bin
        #: The items of the current batch; None before the first lot of this folder.
        self._lot: Lot | None = None
        #: Bins that people have given, which replace those of the grasps.
        self._given = dict[str, tuple[str, str]]()
        #: Current name of each renamed recording, by the name in its grasp's line.
        self._current_names = dict[str, str]()
        self._of_recording = dict[str, GraspSummary]()
        self._recent = deque[Entry](maxlen=LISTED_GRASPS)
        #: Final bin and end time of each item that this station has sorted.
        self._sorted_items = dict[str, tuple[str, str]]()
        #: The last day with grasps, and the number of its grasps by outcome.
        self._day, self._of_day = date.min, Counter[str]()
        #: The grasp that has begun and not ended; at the start, one that was interrupted.
        self.running: Interruption | None = None
        for values in self._read_lines():
            if "renamed" in values:
                self._apply_rename(str(values["recording"]), str(values["renamed"]))
            elif "lot" in values:
                self._lot = self._make_lot(str(values["lot"]))
            elif "began_at" in values:
                self.running = Interruption(
                    item_id=str(values.get("item_id", "")),
                    recording=str(values.get("recording", "")),
                    began_at=str(values["began_at"]),
                )
            elif "cancelled" in values:
                self.running = None
            elif (entry := _parse_entry(values)) is not None:
                self._count_entry(entry)
        #: Number of this run's grasps by outcome and by bin, and the start of the run.
        self.outcomes, self.bins = Counter[str](), Counter[str]()
        self.since = datetime.now(UTC)
        #: Incremented with every change.
        self.version = 0

    @property
    def recent_grasps(self) -> list[Entry]:
        """The last grasps, newest first."""
        return list(reversed(self._recent))

    def find_grasp(self, recording: str) -> GraspSummary | None:
        """Return the grasp of a recording, or None."""
        return self._of_recording.get(recording)

    def find_sorted(self, item_id: str) -> tuple[str, str] | None:
        """Return final bin and local time of a stored item; None if it has no final bin."""
        found = self._given.get(item_id) or self._sorted_items.get(item_id)
        if found is None:
            return None
        ended = datetime.fromisoformat(found[1]).astimezone()
        is_today = ended.date() == datetime.now().date()
        return found[0], f"{ended:%H:%M}" if is_today else f"{ended:%d %b %H:%M}"

    def idle_texts(self) -> list[str]:
        """Return texts on the last grasp and today's counts; empty without grasps."""
        if not self._recent:
            return []
        last = self._recent[-1]
        when = datetime.fromisoformat(last.ended_at).astimezone()
        ended = ", ".join(filter(None, (last.outcome.replace("_", " "), last.firmness)))
        texts = [f"last grasp {when:%d %b %H:%M}: {' '.join(filter(None, (last.item_id, ended)))}"]
        if self._day == datetime.now().date():
            counts = self._of_day.most_common()
            texts.append(
                "today " + ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts)
            )
        return texts

    @property
    def lot(self) -> Lot:
        """The items of the current batch, from this run and earlier ones."""
        return self._lot or Lot()

    def start_lot(self, name: str) -> None:
        """Count the items of another batch from now on.

        Raises
        ------
        OSError
            If the file can't be written; the lot then ends with this run.
        """
        self._lot = self._make_lot(name)
        self._append({"lot": name})

    def _make_lot(self, name: str) -> Lot:
        return Lot(name, default_bin=self._default_bin, given=self._given)

    def set_given_bins(self, given: GivenBins) -> None:
        """Replace the bins that people have given, as the store has them."""
        self._given.clear()
        self._given.update(given)

    def begin_grasp(self, recording: str, *, item_id: str) -> None:
        """Note that a grasp begins, so that its interruption is known after a restart.

        Raises
        ------
        OSError
            If the file can't be written.
        """
        began_at = datetime.now(UTC).isoformat(timespec="milliseconds")
        self.running = Interruption(item_id=item_id, recording=recording, began_at=began_at)
        self._append(asdict(self.running))

    def cancel_grasp(self) -> None:
        """Note that the running grasp ended without a result.

        Raises
        ------
        OSError
            If the file can't be written.
        """
        if self.running is not None:
            cancelled, self.running = self.running.recording, None
            self._append({"cancelled": cancelled})

    def add(self, entry: Entry) -> None:
        """Add a grasp to the history.

        Raises
        ------
        OSError
            If the file can't be written; the grasp is then in memory only.
        """
        if self._lot is None:
            with suppress(OSError):  # raised again below
                self.start_lot("")
        self._count_entry(entry)
        self.outcomes[entry.outcome] += 1
        if entry.bin is not None:
            self.bins[entry.bin] += 1
        self.version += 1
        self._append(asdict(entry))

    def rename(self, before: str, after: str) -> None:
        """Rename a recording in the history.

        Raises
        ------
        OSError
            If the file can't be written; the history is then unchanged.
        """
        if before in self._of_recording:
            self._append({"recording": before, "renamed": after})
            self._apply_rename(before, after)
            self.version += 1

    def csv_parts(self) -> Iterator[str]:
        """Yield the CSV table of all grasps in chunks; column names end in units."""
        columns = ["ended_at", "item_id", "outcome", "verdict", "firmness", "damaged"]
        columns += [*BIN_COLUMNS, "stage", "bruised"]
        columns += [name + end for name in _MEASUREMENTS for end in ("", "_low", "_high")]
        columns += ["decision_time_s", "recording", "simulated"]
        text = io.StringIO()
        table = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        entries = (
            entry for values in self._read_lines() if (entry := _parse_entry(values)) is not None
        )
        while text.tell():
            yield text.getvalue()
            text.seek(0)
            text.truncate()
            table.writerows(self._row(entry) for entry in islice(entries, _CSV_CHUNK_ROWS))

    def _count_entry(self, entry: Entry) -> None:
        self.running = None
        self._recent.append(entry)
        day = datetime.fromisoformat(entry.ended_at).astimezone().date()
        if day != self._day:
            self._day, self._of_day = day, Counter()
        self._of_day[entry.outcome] += 1
        if entry.recording:
            summary = GraspSummary(entry.outcome, entry.item_id, entry.simulated)
            self._of_recording[entry.recording] = summary
        is_sorted = entry.bin is not None or self._default_bin is None
        if entry.outcome != Outcome.HELD or entry.stored is False or not is_sorted:
            return
        # An unnamed item is known by its recording.
        item = entry.item_id or entry.recording
        self._sorted_items.pop(item, None)
        if entry.item_id and entry.bin is not None and not entry.again:
            self._sorted_items[item] = (entry.bin, entry.ended_at)
        if self._lot is not None:
            # A named lot has the items that the store has in this batch, as its report.
            is_other = entry.item_id != "" and self._lot.name not in ("", entry.batch)
            if is_other and entry.batch is not None:
                self._lot.discard(item)
            else:
                self._lot.add(item, bin_name=None if entry.again else entry.bin or "")

    def _apply_rename(self, before: str, after: str) -> None:
        """Replace the name of a recording."""
        for first, name in list(self._current_names.items()):
            if name == before:
                self._current_names[first] = after
        self._current_names.setdefault(before, after)
        summary = self._of_recording.pop(before, None)
        if summary is not None:
            self._of_recording[after] = summary
        renamed = [
            replace(one, recording=after) if one.recording == before else one
            for one in self._recent
        ]
        self._recent = deque(renamed, maxlen=LISTED_GRASPS)

    def _row(self, entry: Entry) -> dict[str, Any]:
        recording = self._current_names.get(entry.recording, entry.recording)
        by = None if entry.bin is None else str(Source.PALPATE)
        bin_cells = (entry.bin, entry.why, entry.probability, entry.again, by)
        cells = {
            **asdict(entry),
            **entry.measured,
            **dict(zip(BIN_COLUMNS, bin_cells, strict=True)),
            "recording": recording,
        }
        return {name: escape_csv_cell(value) for name, value in cells.items()}

    def _append(self, values: dict[str, Any]) -> None:
        """Append a line, after a newline if the last line is truncated.

        A full disk or a power failure may truncate the last line.
        """
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("ab+", buffering=0) as lines:
            end = lines.seek(0, os.SEEK_END)
            lines.seek(max(end - 1, 0))
            # Writes go to the end nevertheless.
            cut = end > 0 and lines.read(1) != b"\n"
            line = ("\n" if cut else "") + json.dumps(values) + "\n"
            if lines.write(line.encode()) < len(line.encode()):
                lines.truncate(end)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._file))

    def _read_lines(self) -> Iterator[dict[str, Any]]:
        """Yield the values of each valid line, oldest first."""
        with suppress(OSError), self._file.open(encoding="utf-8", errors="replace") as lines:
            for line in lines:
                with suppress(ValueError):
                    values = json.loads(line)
                    if isinstance(values, dict):
                        yield values


def _parse_entry(values: dict[str, Any]) -> Entry | None:
    fields_by_name = {name: value for name, value in values.items() if name in _FIELDS}
    try:
        entry = Entry(**fields_by_name | {"curve": tuple(fields_by_name.get("curve", ()))})
        datetime.fromisoformat(entry.ended_at)
    except (TypeError, ValueError):
        return None
    return entry


def make_entry(
    grasped: Grasped,
    *,
    kind: str,
    item_id: str,
    curve: Sequence[Point],
) -> Entry:
    """Return the history entry of a finished grasp; `curve` is the curve on the page."""
    document, result = grasped.document, grasped.document.result
    words = verdict(result, target_force_n=document.target_force_n)
    measured: dict[str, float | None] = {"decision_time_s": result.decision_time_s}
    for name in _MEASUREMENTS:
        measured |= _with_interval(name, getattr(result, name))
    firmness = words["firmness"]
    return Entry(
        ended_at=datetime.now(UTC).isoformat(timespec="milliseconds"),
        recording="" if grasped.recording is None else grasped.recording.name,
        simulated=document.is_simulated,
        item_id=item_id,
        outcome=str(result.outcome),
        verdict=str(words["text"]),
        damaged=None if document.truth is None else bool(document.truth.get("damaged")),
        firmness=None if firmness is None else str(firmness),
        kind=kind,
        measured=measured,
        curve=_thin_out(curve),
    )


def make_stopped_entry(order: GraspOrder, *, is_simulated: bool) -> Entry:
    """Return the history entry of a grasp that was stopped before the hand moved."""
    return Entry(
        ended_at=datetime.now(UTC).isoformat(timespec="milliseconds"),
        recording=order.recording.name,
        simulated=is_simulated,
        item_id=order.item_id,
        outcome=str(Outcome.STOPPED),
        verdict="stopped before the hand moved",
        firmness=None,
        kind="bad",
        measured={},
    )


def _with_interval(name: str, one: Measurement | None) -> dict[str, float | None]:
    if one is None:
        return {}
    low, high = one.known_ends
    return {name: one.value if one.has_value else None, f"{name}_low": low, f"{name}_high": high}


def _thin_out(curve: Sequence[Point]) -> tuple[float, ...]:
    """Return the curve resampled to few points, evenly spaced in time."""
    if len(curve) < 2:
        return ()
    forces = [(one.time_s, one.force.middle) for one in curve if one.force is not None]
    time_s, values = zip(*(forces or [(one.time_s, one.percent) for one in curve]), strict=True)
    at_s = np.linspace(time_s[0], time_s[-1], _CURVE_POINTS)
    return tuple(round(float(value), 2) for value in np.interp(at_s, time_s, values))


def check_name(stem: str) -> str:
    """Return the file name of a recording with this stem.

    Raises
    ------
    InputError
        If the name could refer to another folder or to a hidden file.

    Examples
    --------
    >>> check_name("monday 3")
    'monday 3.mcap'
    >>> check_name("a/b")
    Traceback (most recent call last):
    palpate.errors.InputError: 'a/b': a name may contain only letters, digits, spaces, dots, - and _
    """
    stem = stem.strip()
    usable = all(letter.isalnum() or letter in " -_." for letter in stem)
    if not stem or len(stem) > 80 or stem.startswith(".") or not usable:
        raise InputError(
            f"{stem!r}: a name may contain only letters, digits, spaces, dots, - and _"
        )
    return f"{stem}{_SUFFIX}"


#: Number of recordings that the page lists.
LISTED_RECORDINGS = 100
#: Coarsest resolution of modification times (FAT: 2 s), nanoseconds.
_MTIME_STEP_NS = 2_000_000_000


class RecordingList:
    """The newest recordings of a folder that may contain hundreds of thousands of files.

    The folder is scanned only after it has changed, and only new files are queried for their
    modification time. The class is thread-safe.

    Parameters
    ----------
    folder : Path
        The folder; it may not exist yet.
    now_ns : callable
        Returns the current time, nanoseconds.
    """

    def __init__(self, folder: Path, *, now_ns: Callable[[], int] = time.time_ns) -> None:
        self._folder, self._now_ns, self._lock = folder, now_ns, Lock()
        #: Modification time of the folder at the last scan, and time of the next repeated scan.
        self._scanned_mtime_ns, self._rescan_ns = -1, math.inf
        #: Modification time of each recording at its first scan.
        self._mtime_s = dict[str, float]()
        self._newest: list[str] = []

    def newest(self) -> list[tuple[Path, os.stat_result]]:
        """Return the newest recordings, at most `LISTED_RECORDINGS`, with their status."""
        with self._lock:
            try:
                changed_ns = self._folder.stat().st_mtime_ns
                now_ns = self._now_ns()
                if changed_ns != self._scanned_mtime_ns or now_ns > self._rescan_ns:
                    self._rescan()
                    self._scanned_mtime_ns = changed_ns
                    # More files may follow without a change of the modification time.
                    unsettled = now_ns - changed_ns < _MTIME_STEP_NS
                    self._rescan_ns = now_ns + _MTIME_STEP_NS if unsettled else math.inf
            except OSError:
                return []
            names = self._newest
        listed = []
        for name in names:
            with suppress(OSError):  # the file was deleted in the meantime
                listed.append((self._folder / name, (self._folder / name).stat()))
        return sorted(listed, key=lambda one: (one[1].st_mtime, one[0].name), reverse=True)

    def _rescan(self) -> None:
        # Plain loops: set operations on many names would block all other threads.
        names = os.listdir(self._folder)
        found, new = 0, []
        for name in names:
            if name in self._mtime_s:
                found += 1
            elif name.endswith(_SUFFIX):
                new.append(name)
        has_deletions = found < len(self._mtime_s)
        if has_deletions:
            present = set(names)
            self._mtime_s = {n: s for n, s in self._mtime_s.items() if n in present}
        for name in new:
            with suppress(OSError):  # a dangling link, or deleted in the meantime
                self._mtime_s[name] = (self._folder / name).stat().st_mtime
        # If no file was deleted, only new files can replace the newest ones.
        candidates = self._mtime_s if has_deletions else {*self._newest, *new}
        self._newest = heapq.nlargest(
            LISTED_RECORDINGS,
            (name for name in candidates if name in self._mtime_s),
            key=lambda name: (self._mtime_s[name], name),
        )


def make_recording_path(folder: Path, prefix: str) -> Path:
    """Return an unused path for a recording: prefix, time stamp and a number if needed."""
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    file = folder / f"{prefix}-{stamp}{_SUFFIX}"
    number = 1
    while file.exists():
        number += 1
        file = folder / f"{prefix}-{stamp}-{number}{_SUFFIX}"
    return file


def find_recording(folder: Path, name: str) -> Path:
    """Return the path of a recording of the folder.

    Raises
    ------
    InputError
        If the name is not a plain file name, or the file does not exist or is a symbolic link.
    """
    file = folder / name
    is_plain = name == Path(name).name and name.endswith(_SUFFIX) and "\0" not in name
    try:
        if is_plain and not file.is_symlink() and file.is_file():
            return file
    except (OSError, ValueError):  # such as a name that is too long for the file system
        pass
    shown = name if len(name) <= _MAX_SHOWN_NAME else f"{name[:_MAX_SHOWN_NAME]}..."
    raise InputError(f"{shown!r}: no such recording in the folder")


def rename_recording(folder: Path, name: str, stem: str) -> Path:
    """Rename a recording in its folder; return the new file.

    Raises
    ------
    InputError
        If the recording does not exist, or the new name is invalid or already used.
    """
    file, renamed = find_recording(folder, name), folder / check_name(stem)
    try:
        # Unlike a rename, a hard link never replaces an existing file.
        os.link(file, renamed)
        file.unlink()
    except FileExistsError as error:
        raise InputError(f"{renamed.stem}: a recording with this name already exists") from error
    except OSError as error:
        raise InputError(f"{name} can't be renamed: {error.strerror}") from error
    return renamed


def delete_recording(folder: Path, name: str) -> None:
    """Delete a recording.

    Raises
    ------
    InputError
        If the recording does not exist or can't be deleted.
    """
    try:
        find_recording(folder, name).unlink()
    except OSError as error:
        raise InputError(f"{name} can't be deleted: {error.strerror}") from error


def is_simulated(file: Path, status: os.stat_result) -> bool:
    """Return whether a recording is simulated; False if it is unreadable."""
    return _read_state(file, status.st_mtime_ns)[0] not in ("hardware", "")


def describe_damage(file: Path, status: os.stat_result) -> str:
    """Return what is missing or damaged in a recording, or why it can't be read; else empty."""
    return _read_state(file, status.st_mtime_ns)[1]


@lru_cache(maxsize=1000)
def _read_state(file: Path, changed_ns: int) -> tuple[str, str]:
    """Return the origin and the damage of a recording."""
    del changed_ns  # only part of the cache key: a file that has grown may have become readable
    try:
        with RecordingReader(file) as reader:
            return reader.info.origin, reader.state.describe()
    except (PalpateError, OSError) as error:
        return "", str(error).removeprefix(f"{file}: ")
