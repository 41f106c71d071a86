"""Recordings and their holds as tables: CSV or Parquet, batch by batch in bounded memory."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from palpate.errors import needing
from palpate.files import atomic_path
from palpate.gripper.interface import GripperState
from palpate.holds import Hold
from palpate.recording.contents import Event
from palpate.recording.reader import RecordingReader
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.pixel_resistance import pixel_resistance_ohm

Table = dict[str, list[Any]]
Format = Literal["csv", "parquet"]
_BATCH = 20_000


def frame_tables(reader: RecordingReader) -> Iterator[Table]:
    """Yield the recording as columns, a batch of frames at a time.

    One row per frame: time, number, oversampling, the gripper's state and the text of events up to
    it, raw counts and resistances by pixel. What is not known is None.

    Parameters
    ----------
    reader : RecordingReader
        An open recording.
    """
    rows = _rows(reader)
    while batch := list(islice(rows, _BATCH)):
        yield _columns(batch, reader.info.layout)


def hold_tables(holds: Iterable[Hold]) -> Iterator[Table]:
    """Yield holds in the form that `palpate settle` reads, one channel at a time."""
    for hold in holds:
        count = len(hold.time_s)
        yield {
            "hold_id": [hold.hold_id] * count,
            "time_s": hold.time_s.tolist(),
            "value": hold.values.tolist(),
            "channel": [hold.channel] * count,
            "unit": [hold.unit] * count,
        }


def write_tables(path: str | os.PathLike[str], tables: Iterable[Table], *, to: Format) -> int:
    """Write tables of the same columns below one another; return the number of rows.

    Parameters
    ----------
    path : path
        Written whole or not at all.
    tables : iterable of dict
        Column -> values.
    to : {"csv", "parquet"}
        Form of the file.

    Raises
    ------
    MissingExtraError
        If Parquet is asked for without pyarrow.
    """
    with atomic_path(path) as partial:
        if to == "csv":
            return _write_csv(partial, tables)
        return _write_parquet(partial, tables)


def _rows(reader: RecordingReader) -> Iterator[tuple[Frame, GripperState | None, str]]:
    gripper: GripperState | None = None
    happened: list[str] = []
    for message in reader.messages():
        if isinstance(message, GripperState):
            gripper = message
        elif isinstance(message, Event):
            happened.append(f"{message.name}: {message.text}" if message.text else message.name)
        elif isinstance(message, Frame):
            yield message, gripper, "; ".join(happened)
            happened.clear()


def _columns(batch: list[tuple[Frame, GripperState | None, str]], layout: ArrayLayout) -> Table:
    frames = [frame for frame, _, _ in batch]
    states = [state for _, state, _ in batch]
    table: Table = {
        "time_s": [frame.time_s for frame in frames],
        "sequence": [frame.sequence for frame in frames],
        "oversampling": [frame.oversampling for frame in frames],
    }
    for name in ("width_mm", "pressure_kpa", "current_ma"):
        sensed = [np.nan if state is None else getattr(state, name) for state in states]
        table[name] = [None if np.isnan(value) else float(value) for value in sensed]
    table["moving"] = [None if state is None else state.moving for state in states]
    table["events"] = [text or None for _, _, text in batch]
    ohms = _resistances(frames, layout)
    for row in range(layout.rows):
        for col in range(layout.cols):
            table[f"r{row}c{col}_counts"] = [int(frame.counts[row, col]) for frame in frames]
            table[f"r{row}c{col}_ohm"] = [float(ohm[row, col]) for ohm in ohms]
    return table


def _resistances(frames: list[Frame], layout: ArrayLayout) -> NDArray[np.float64]:
    """Solve the frames of a batch together, those of equal oversampling at a time."""
    counts = np.stack([frame.counts for frame in frames])
    oversampling = np.array([frame.oversampling for frame in frames])
    ohm = np.empty(counts.shape)
    for conversions in np.unique(oversampling):
        alike = oversampling == conversions
        ohm[alike] = pixel_resistance_ohm(
            counts[alike], layout=layout, oversampling=int(conversions)
        )
    return ohm


def _write_csv(path: Path, tables: Iterable[Table]) -> int:
    rows = 0
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        for number, table in enumerate(tables):
            if number == 0:
                writer.writerow(table)
            columns = list(table.values())
            writer.writerows(zip(*columns, strict=True))
            rows += len(columns[0])
    return rows


def _write_parquet(path: Path, tables: Iterable[Table]) -> int:
    with needing("Parquet (unlike --to csv)", extra="data"):
        import pyarrow
        import pyarrow.parquet
    rows = 0
    writer = None
    try:
        for table in tables:
            batch = pyarrow.table(
                {name: pyarrow.array(column, type=_kind(name)) for name, column in table.items()}
            )
            writer = writer or pyarrow.parquet.ParquetWriter(path, batch.schema)
            writer.write_table(batch)
            rows += batch.num_rows
    finally:
        if writer is not None:
            writer.close()
    return rows


def _kind(column: str) -> str:
    """Name the Arrow type of a column: a batch without any value must not change it."""
    if column in ("events", "hold_id", "channel", "unit"):
        return "string"
    if column == "moving":
        return "bool"
    if column in ("sequence", "oversampling") or column.endswith("_counts"):
        return "int64"
    return "float64"
