"""Add recordings and stores to an archive, each once."""

from __future__ import annotations

import hashlib
import os
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from palpate.errors import InputError, RecordingError
from palpate.holds import Hold
from palpate.recording.exporting import cut_recorded_holds, frame_tables
from palpate.recording.reader import RecordingReader, load_recording
from palpate_archive.catalogue import Catalogue, Entry, Part
from palpate_archive.folders import Folder
from palpate_archive.layout import SIMULATED, check_name, hash_file, write_tables
from palpate_station.records import Grasp
from palpate_station.store.database import Store
from palpate_station.store.export import grasp_row, grasp_schema

_BATCH = 10_000
#: Seconds between versions of the catalogue; an interrupted call repeats at most that much.
_COMMIT_S = 60.0
_LABELS = {"recording": pa.string(), "origin": pa.string()}
#: Columns of a holds file.
_HOLDS = pa.schema(
    _LABELS
    | {"hold_id": pa.string(), "time_s": pa.float64(), "value": pa.float64()}
    | {"channel": pa.string(), "unit": pa.string()}
)
#: Columns that do not depend on the sensor.
_FRAMES = pa.schema(
    _LABELS
    | {"time_s": pa.float64(), "sequence": pa.int64(), "oversampling": pa.int32()}
    | dict.fromkeys(("width_mm", "pressure_kpa", "current_ma"), pa.float64())
    | {"moving": pa.bool_(), "events": pa.string(), "rows": pa.int16(), "cols": pa.int16()}
    | {"counts": pa.list_(pa.int32()), "ohm": pa.list_(pa.float64())}
)


def find_recordings(addresses: Iterable[str]) -> Iterator[str]:
    """Yield the given recordings, and recordings in given folders sorted by name.

    Raises `InputError` if one does not exist.
    """
    for address in addresses:
        folder = Folder.open(address)
        if not folder.fs.exists(""):
            raise InputError(f"{address}: no such file or folder")
        if folder.fs.isdir(""):
            yield from (folder.name(place) for place in folder.find() if place.endswith(".mcap"))
        else:
            yield address


def add_recordings(
    archive: Folder, paths: Iterable[str | os.PathLike[str]], *, station: str | None = None
) -> Iterator[dict[str, int]]:
    """Add the frames and holds of recordings; yield the row counts of each recording.

    `paths`: files or addresses. `station`: place of the recordings; by default the name of each
    recording's rig. Yields kind -> rows, empty if the archive already contains the recording.
    Raises `RecordingError` if a recording is incomplete; `palpate inspect --recover` repairs it.
    The recordings before it have then been added.
    """
    held = Catalogue(archive, "frames").sources()
    new = list[Entry]()
    since_s = time.monotonic()
    try:
        for path in paths:
            folder, name = Folder.divide(path)
            added = list[Entry]()
            with folder.fetch(name) as local:
                source = hash_file(local)
                if source not in held:
                    added = list(_write_recording(archive, local, source, station))
            held.add(source)
            new += added
            yield {entry.part.kind: entry.rows for entry in added}
            if time.monotonic() - since_s > _COMMIT_S:
                _commit(archive, new)
                since_s = time.monotonic()
    finally:
        _commit(archive, new)


def _commit(archive: Folder, new: list[Entry]) -> None:
    """Enter new files in the catalogue; frames last, as they mark a recording as added."""
    for kind in ("holds", "frames"):
        Catalogue(archive, kind).add(entry for entry in new if entry.part.kind == kind)
    new.clear()


def _write_recording(
    archive: Folder, path: Path, source: str, station: str | None
) -> Iterator[Entry]:
    """Write the holds and frames of a recording; yield the entry of each file."""
    with RecordingReader(path) as reader:
        info = reader.info
        station = check_name("station", station or Path(info.rig or "unknown").stem)
        taken_at = datetime.fromtimestamp(info.clock_zero_unix_ns / 1e9, tz=UTC)
        date = f"{taken_at:%Y-%m-%d}" if info.clock_zero_unix_ns else SIMULATED
        name = f"{sanitize(path.stem)}-{source[:12]}"
        labels = {"recording": name, "origin": info.origin}
        # A recording without holds is archived too.
        with suppress(RecordingError):
            if holds := cut_recorded_holds(load_recording(path), name=name):
                place = Part("holds", station, date, name).place
                yield write_tables(archive, place, [_hold_table(holds, labels)], sources=[source])
        constant = labels | {"rows": info.layout.rows, "cols": info.layout.cols}
        frames = (_frame_table(table, constant) for table in frame_tables(reader))
        place = Part("frames", station, date, name).place
        yield write_tables(archive, place, frames, sources=[source])


def sanitize(stem: str) -> str:
    """Return the part of a recording's label that comes from its file name."""
    return "".join(sign if sign.isalnum() and sign.isascii() else "-" for sign in stem)[:40]


def _hold_table(holds: Sequence[Hold], labels: Mapping[str, str]) -> Any:
    """Return holds as a table with the columns of a holds file."""
    counts = [len(hold.time_s) for hold in holds]
    columns: dict[str, Any] = {name: [text] * sum(counts) for name, text in labels.items()}
    for name in ("hold_id", "channel", "unit"):
        columns[name] = np.repeat([str(getattr(hold, name)) for hold in holds], counts)
    columns["time_s"] = np.concatenate([hold.time_s for hold in holds])
    columns["value"] = np.concatenate([hold.values for hold in holds])
    return pa.Table.from_pydict(columns, schema=_HOLDS)


def _frame_table(table: dict[str, list[Any]], constant: Mapping[str, Any]) -> Any:
    """Return frames as a table whose columns do not depend on the sensor."""
    pixels = [f"r{row}c{col}" for row in range(constant["rows"]) for col in range(constant["cols"])]
    columns = {name: [value] * len(table["time_s"]) for name, value in constant.items()}
    for ending in ("counts", "ohm"):
        columns[ending] = list(zip(*(table[f"{pixel}_{ending}"] for pixel in pixels), strict=True))
    return pa.Table.from_pydict(table | columns, schema=_FRAMES)


def add_store(archive: Folder, store: Store, *, station: str) -> dict[str, int]:
    """Add the new grasps of a store; return row counts by kind."""
    catalogue = Catalogue(archive, "grasps")
    held = catalogue.sources()
    fresh = (grasp for grasp in store.grasps() if grasp.grasp_id not in held)
    entries = list[Entry]()
    while batch := list(islice(fresh, _BATCH)):
        items = {one.item_id: one for one in store.find_items(list({g.item_id for g in batch}))}
        days = defaultdict[str, list[Grasp]](list)
        for grasp in batch:
            days[f"{grasp.taken_at.astimezone(UTC):%Y-%m-%d}"].append(grasp)
        for date, taken in days.items():
            rows = [grasp_row(grasp, items.get(grasp.item_id)) for grasp in taken]
            table = pa.Table.from_pylist(rows, schema=grasp_schema())
            sources = [grasp.grasp_id for grasp in taken]
            name = hashlib.sha256("\n".join(sources).encode()).hexdigest()[:12]
            place = Part("grasps", station, date, f"grasps-{name}").place
            entries.append(write_tables(archive, place, [table], sources=sources))
    catalogue.add(entries)
    return {"grasps": sum(entry.rows for entry in entries)} if entries else {}
