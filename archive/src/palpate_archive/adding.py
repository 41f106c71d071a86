"""Add recordings and stores to an archive, each part once."""

from __future__ import annotations

import hashlib
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa

from palpate.errors import RecordingError
from palpate.holds import Hold
from palpate.produce.records import Grasp, Item
from palpate.produce.store.database import Store
from palpate.produce.store.export import grasp_row, grasp_schema
from palpate.recording.exporting import cut_recorded_holds, frame_tables
from palpate.recording.reader import RecordingReader, load_recording
from palpate_archive.layout import SIMULATED, Archive, Part, check_name

_BATCH = 10_000


def add_recordings(
    archive: Archive, paths: Iterable[str | os.PathLike[str]], *, station: str | None = None
) -> Iterator[dict[str, int]]:
    """Add the frames and holds of recordings; yield the row counts of each recording.

    `station`: place of the recordings; by default the name of each recording's rig.
    Yields kind -> rows, empty if the archive already contains the recording. Raises
    `RecordingError` if a recording is incomplete; `palpate inspect --recover` repairs it. The
    recordings before it have then been added.
    """
    held = set(archive.sources("frames"))
    for path in paths:
        source = _fingerprint(Path(path))
        yield {} if source in held else _add_recording(archive, Path(path), source, station)
        held.add(source)


def _add_recording(
    archive: Archive, path: Path, source: str, station: str | None
) -> dict[str, int]:
    with RecordingReader(path) as reader:
        info = reader.info
        station = check_name("station", station or Path(info.rig or "unknown").stem)
        date = _format_day(info.clock_zero_unix_ns)
        name = f"{_sanitize(path.stem)}-{source[:12]}"
        labels = {"recording": name, "origin": info.origin}

        def part(kind: str) -> Part:
            return Part(kind=kind, station=station, date=date, name=name)

        added = {}
        # Frames are written last: their presence marks the recording as added.
        if holds := _cut_holds(path, name):
            added["holds"] = archive.write(
                part("holds"), [_hold_table(holds, labels)], sources=[source]
            )
        layout = info.layout
        frames = (
            _frame_table(table, labels, layout.rows, layout.cols) for table in frame_tables(reader)
        )
        added["frames"] = archive.write(part("frames"), frames, sources=[source])
    return added


def add_store(archive: Archive, store: Store, *, station: str) -> dict[str, int]:
    """Add the new grasps of a store; return row counts by kind."""
    check_name("station", station)
    held = {
        grasp_id
        for part in archive.parts("grasps")
        if part.station == station
        for grasp_id in pa.parquet.read_table(archive.path(part), columns=["grasp_id"])[
            "grasp_id"
        ].to_pylist()
    }
    fresh = (grasp for grasp in store.grasps() if grasp.grasp_id not in held)
    rows = 0
    while batch := list(islice(fresh, _BATCH)):
        items = {one.item_id: one for one in store.find_items(list({g.item_id for g in batch}))}
        rows += _add_grasps(archive, batch, items, station=station)
    return {"grasps": rows} if rows else {}


def _add_grasps(
    archive: Archive, grasps: Iterable[Grasp], items: dict[str, Item], *, station: str
) -> int:
    days = defaultdict[str, list[Grasp]](list)
    for grasp in grasps:
        days[f"{grasp.taken_at.astimezone(UTC):%Y-%m-%d}"].append(grasp)
    rows = 0
    for date, taken in days.items():
        table = pa.Table.from_pylist(
            [grasp_row(grasp, items.get(grasp.item_id)) for grasp in taken], schema=grasp_schema()
        )
        name = hashlib.sha256("\n".join(g.grasp_id for g in taken).encode()).hexdigest()[:12]
        part = Part(kind="grasps", station=station, date=date, name=f"grasps-{name}")
        rows += archive.write(part, [table], sources=[name])
    return rows


def _fingerprint(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _format_day(clock_zero_unix_ns: int) -> str:
    if clock_zero_unix_ns == 0:
        return SIMULATED
    return f"{datetime.fromtimestamp(clock_zero_unix_ns / 1e9, tz=UTC):%Y-%m-%d}"


def _sanitize(stem: str) -> str:
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


def find_recordings(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield the given recordings, and recordings in given folders sorted by name."""
    for path in paths:
        yield from sorted(path.rglob("*.mcap")) if path.is_dir() else [path]
