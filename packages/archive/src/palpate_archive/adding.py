"""Add recordings and stores to an archive, each once."""

from __future__ import annotations

import hashlib
import os
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa

from palpate.errors import InputError, RecordingError
from palpate.holds import Hold
from palpate.recording.exporting import cut_recorded_holds, frame_tables
from palpate.recording.reader import RecordingReader, load_recording
from palpate_archive.catalogue import Entry
from palpate_archive.folders import Folder
from palpate_archive.layout import SIMULATED, Archive, Part, check_name
from palpate_station.records import Grasp, Item
from palpate_station.store.database import Store
from palpate_station.store.export import grasp_row, grasp_schema

_BATCH = 10_000
#: Seconds between versions of the catalogue; an interrupted call repeats at most that much.
_COMMIT_S = 60.0
#: Versions of the catalogue that may still be in use, s.
GRACE_S = 3600.0

_New = dict[str, dict[str, list[Entry]]]


def add_recordings(
    archive: Archive, paths: Iterable[str | os.PathLike[str]], *, station: str | None = None
) -> Iterator[dict[str, int]]:
    """Add the frames and holds of recordings; yield the row counts of each recording.

    `paths`: files or addresses. `station`: place of the recordings; by default the name of each
    recording's rig. Yields kind -> rows, empty if the archive already contains the recording.
    Raises `RecordingError` if a recording is incomplete; `palpate inspect --recover` repairs it.
    The recordings before it have then been added.
    """
    held = {kind: archive.catalogue(kind).sources() for kind in ("frames", "holds")}
    new: _New = {kind: defaultdict(list) for kind in ("holds", "frames")}
    since_s = time.monotonic()
    try:
        for path in paths:
            folder, _, name = os.fspath(path).rpartition("/")
            with Folder.open(folder or ".").fetch(name) as local:
                source = _fingerprint(local)
                added = {}
                if source not in held["frames"]:
                    for entry, its_station in _write_recording(archive, local, source, station):
                        kind = entry.file.split("/")[0]
                        added[kind] = entry.rows
                        # Holds without frames: an earlier call was interrupted between them.
                        if source not in held[kind]:
                            new[kind][its_station].append(entry)
                            held[kind].add(source)
            yield added
            if time.monotonic() - since_s > _COMMIT_S:
                _commit(archive, new)
                since_s = time.monotonic()
    finally:
        _commit(archive, new)


def _commit(archive: Archive, new: _New) -> None:
    """Enter new files in the catalogue; frames last, as they mark a recording as added."""
    for kind, stations in new.items():
        for station, entries in stations.items():
            catalogue = archive.catalogue(kind)
            catalogue.add(station, entries)
            catalogue.expire(station, grace_s=GRACE_S)
        stations.clear()


def _write_recording(
    archive: Archive, path: Path, source: str, station: str | None
) -> Iterator[tuple[Entry, str]]:
    """Write the holds and frames of a recording; yield each entry and its station."""
    with RecordingReader(path) as reader:
        info = reader.info
        station = check_name("station", station or Path(info.rig or "unknown").stem)
        date = _format_day(info.clock_zero_unix_ns)
        name = f"{sanitize(path.stem)}-{source[:12]}"
        labels = {"recording": name, "origin": info.origin}

        def write(kind: str, tables: Iterable[Any]) -> tuple[Entry, str]:
            part = Part(kind=kind, station=station, date=date, name=name)
            return archive.write(part, tables, sources=[source]), station

        if holds := _cut_holds(path, name):
            yield write("holds", [_hold_table(holds, labels)])
        shape = (info.layout.rows, info.layout.cols)
        frames = (_frame_table(table, labels, *shape) for table in frame_tables(reader))
        yield write("frames", frames)


def add_store(archive: Archive, store: Store, *, station: str) -> dict[str, int]:
    """Add the new grasps of a store; return row counts by kind."""
    check_name("station", station)
    catalogue = archive.catalogue("grasps")
    held = catalogue.sources()
    fresh = (grasp for grasp in store.grasps() if grasp.grasp_id not in held)
    entries = list[Entry]()
    while batch := list(islice(fresh, _BATCH)):
        items = {one.item_id: one for one in store.find_items(list({g.item_id for g in batch}))}
        entries += _write_grasps(archive, batch, items, station=station)
    if not entries:
        return {}
    catalogue.add(station, entries)
    catalogue.expire(station, grace_s=GRACE_S)
    return {"grasps": sum(entry.rows for entry in entries)}


def _write_grasps(
    archive: Archive, grasps: Iterable[Grasp], items: dict[str, Item], *, station: str
) -> Iterator[Entry]:
    days = defaultdict[str, list[Grasp]](list)
    for grasp in grasps:
        days[f"{grasp.taken_at.astimezone(UTC):%Y-%m-%d}"].append(grasp)
    for date, taken in days.items():
        table = pa.Table.from_pylist(
            [grasp_row(grasp, items.get(grasp.item_id)) for grasp in taken], schema=grasp_schema()
        )
        sources = [grasp.grasp_id for grasp in taken]
        name = hashlib.sha256("\n".join(sources).encode()).hexdigest()[:12]
        part = Part(kind="grasps", station=station, date=date, name=f"grasps-{name}")
        yield archive.write(part, [table], sources=sources)


def _fingerprint(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _format_day(clock_zero_unix_ns: int) -> str:
    if clock_zero_unix_ns == 0:
        return SIMULATED
    return f"{datetime.fromtimestamp(clock_zero_unix_ns / 1e9, tz=UTC):%Y-%m-%d}"


def sanitize(stem: str) -> str:
    """Return the part of a recording's label that comes from its file name."""
    return "".join(sign if sign.isalnum() and sign.isascii() else "-" for sign in stem)[:40]


def _cut_holds(path: Path, name: str) -> list[Hold]:
    try:
        return cut_recorded_holds(load_recording(path), name=name)
    except RecordingError:
        # A recording without holds is archived too.
        return []


def _hold_table(holds: Iterable[Hold], labels: dict[str, str]) -> Any:
    """Return holds as a table with the columns of a holds file."""
    columns: dict[str, list[Any]] = {
        name: [] for name in ("hold_id", "time_s", "value", "channel", "unit")
    }
    for hold in holds:
        count = len(hold.time_s)
        columns["hold_id"] += [hold.hold_id] * count
        columns["time_s"] += hold.time_s.tolist()
        columns["value"] += hold.values.tolist()
        columns["channel"] += [hold.channel] * count
        columns["unit"] += [hold.unit] * count
    kinds = {"time_s": pa.float64(), "value": pa.float64()}
    return _label_rows(
        {name: pa.array(v, type=kinds.get(name, pa.string())) for name, v in columns.items()},
        labels,
    )


def _frame_table(table: dict[str, list[Any]], labels: dict[str, str], rows: int, cols: int) -> Any:
    """Return frames as a table whose columns do not depend on the sensor."""
    pixels = [f"r{row}c{col}" for row in range(rows) for col in range(cols)]
    count = len(table["time_s"])
    columns = {
        name: pa.array(table[name], type=kind)
        for name, kind in (
            ("time_s", pa.float64()),
            ("sequence", pa.int64()),
            ("oversampling", pa.int32()),
            ("width_mm", pa.float64()),
            ("pressure_kpa", pa.float64()),
            ("current_ma", pa.float64()),
            ("moving", pa.bool_()),
            ("events", pa.string()),
        )
    }
    columns["rows"] = pa.array([rows] * count, type=pa.int16())
    columns["cols"] = pa.array([cols] * count, type=pa.int16())
    for ending, kind in (("counts", pa.int32()), ("ohm", pa.float64())):
        each = zip(*(table[f"{pixel}_{ending}"] for pixel in pixels), strict=True)
        columns[ending] = pa.array(each, type=pa.list_(kind))
    return _label_rows(columns, labels)


def _label_rows(columns: dict[str, Any], labels: dict[str, str]) -> Any:
    """Return a table with the labels as first columns."""
    count = len(next(iter(columns.values())))
    named = {name: pa.array([text] * count, type=pa.string()) for name, text in labels.items()}
    return pa.table(named | columns)


def find_recordings(addresses: Iterable[str]) -> Iterator[str]:
    """Yield the given recordings, and recordings in given folders sorted by name.

    Raises `InputError` if one does not exist.
    """
    for address in addresses:
        folder = Folder.open(address)
        if not folder.exists():
            raise InputError(f"{address}: no such file or folder")
        if folder.fs.isdir(folder.path):
            yield from (folder.name(place) for place in folder.find() if place.endswith(".mcap"))
        else:
            yield address
