"""Export of a recording to a table of frames or a holds file."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError, RecordingError
from palpate.files import atomic_path, escape_csv_cell
from palpate.gripper.interface import GripperState
from palpate.holds import Hold
from palpate.holds.contacts import SHORTEST_HOLD_S, find_contacts
from palpate.holds.table_files import import_pyarrow
from palpate.recording.contents import Event, GripperTrack, Recording
from palpate.recording.reader import RecordingReader, load_recording
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import SampleReader, pixel_resistance_ohm
from palpate.signal.relative import CONTACT_PERCENT, largest_change, mean_change

Columns = dict[str, list[Any]]
Format = Literal["csv", "parquet"]
_BATCH = 20_000

HoldUnit = Literal["percent", "ohm"]
#: Duration of the initial rest if no state before the first movement was recorded, seconds.
REST_S = 1.0
_MIN_FRAMES = 10
#: A change of position above this is movement: more than an encoder step or a regulator's noise.
_MOVED_MM, _MOVED_KPA = 0.08, 0.6


def frame_tables(reader: RecordingReader) -> Iterator[Columns]:
    """Yield the recording as columns, a batch of frames at a time.

    Each row is one frame: time, number, oversampling, the gripper's latest state, the text of the
    events since the previous frame, raw counts and resistances by pixel. Unknown values are None.
    """
    rows = _iterate_rows(reader)
    while batch := list(islice(rows, _BATCH)):
        yield _build_columns(batch, reader.info.layout)


def tabulate_frames(recording: Recording) -> Columns:
    """Return a recording in memory as the columns of `frame_tables`."""
    track, events = recording.gripper, sorted(recording.events, key=lambda event: event.time_s)
    latest = np.searchsorted(track.time_s, recording.time_s, side="right") - 1
    states = [
        GripperState(
            time_s=track.time_s[one],
            width_mm=track.width_mm[one],
            pressure_kpa=track.pressure_kpa[one],
            current_ma=track.current_ma[one],
            moving=bool(track.moving[one]),
        )
        if one >= 0
        else None
        for one in latest
    ]
    ends = np.searchsorted([event.time_s for event in events], recording.time_s, side="right")
    texts = ["; ".join(map(_describe_event, events[a:b])) for a, b in pairwise([0, *ends])]
    frames = [
        Frame(time_s=time_s, sequence=sequence, counts=counts, oversampling=summed)
        for time_s, sequence, counts, summed in zip(
            recording.time_s.tolist(),
            recording.sequence.tolist(),
            recording.counts,
            recording.oversampling.tolist(),
            strict=True,
        )
    ]
    return _build_columns(list(zip(frames, states, texts, strict=True)), recording.info.layout)


def hold_tables(holds: Iterable[Hold]) -> Iterator[Columns]:
    """Yield holds in the format of a holds file, one channel at a time."""
    for hold in holds:
        count = len(hold.time_s)
        yield {
            "hold_id": [hold.hold_id] * count,
            "time_s": hold.time_s.tolist(),
            "value": hold.values.tolist(),
            "channel": [hold.channel] * count,
            "unit": [hold.unit] * count,
        }


def write_export(path: str | os.PathLike[str], tables: Iterable[Columns], *, to: Format) -> int:
    """Write tables with equal columns one after another; return the number of rows.

    `path`: written atomically.
    `tables`: column -> values.
    `to` ("csv" or "parquet"): file format.
    Raises `MissingExtraError` if Parquet is requested without pyarrow.
    """
    with atomic_path(path) as partial:
        if to == "csv":
            return _write_csv(partial, tables)
        return _write_parquet(partial, tables)


def _iterate_rows(reader: RecordingReader) -> Iterator[tuple[Frame, GripperState | None, str]]:
    gripper: GripperState | None = None
    events: list[str] = []
    for message in reader.messages():
        if isinstance(message, GripperState):
            gripper = message
        elif isinstance(message, Event):
            events.append(_describe_event(message))
        elif isinstance(message, Frame):
            yield message, gripper, "; ".join(events)
            events.clear()


def _describe_event(event: Event) -> str:
    return f"{event.name}: {event.text}" if event.text else event.name


def _build_columns(
    batch: list[tuple[Frame, GripperState | None, str]], layout: ArrayLayout
) -> Columns:
    frames = [frame for frame, _, _ in batch]
    states = [state for _, state, _ in batch]
    table: Columns = {
        "time_s": [frame.time_s for frame in frames],
        "sequence": [frame.sequence for frame in frames],
        "oversampling": [frame.oversampling for frame in frames],
    }
    for name in ("width_mm", "pressure_kpa", "current_ma"):
        sensed = [np.nan if state is None else getattr(state, name) for state in states]
        table[name] = [None if np.isnan(value) else float(value) for value in sensed]
    table["moving"] = [None if state is None else state.moving for state in states]
    table["events"] = [text or None for _, _, text in batch]
    ohms = _resistance_ohm(
        np.stack([frame.counts for frame in frames]),
        layout=layout,
        oversampling=np.array(table["oversampling"]),
    )
    for row in range(layout.rows):
        for col in range(layout.cols):
            table[f"r{row}c{col}_counts"] = [int(frame.counts[row, col]) for frame in frames]
            table[f"r{row}c{col}_ohm"] = ohms[:, row, col].tolist()
    return table


def _resistance_ohm(
    counts: NDArray[np.integer[Any]],
    *,
    layout: ArrayLayout,
    oversampling: NDArray[np.integer[Any]],
) -> FloatArray:
    """Return the pixels' resistances."""
    try:
        return pixel_resistance_ohm(counts, layout=layout, oversampling=oversampling)
    except ValueError as error:
        raise RecordingError(f"a frame of the recording: {error}") from error


def _write_csv(path: Path, tables: Iterable[Columns]) -> int:
    rows = 0
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        for number, table in enumerate(tables):
            if number == 0:
                writer.writerow(table)
            columns = [
                list(map(escape_csv_cell, values)) if _arrow_type(name) == "string" else values
                for name, values in table.items()
            ]
            writer.writerows(zip(*columns, strict=True))
            rows += len(columns[0])
    return rows


def _write_parquet(path: Path, tables: Iterable[Columns]) -> int:
    pyarrow = import_pyarrow("Parquet (unlike --to csv)")
    rows = 0
    writer = None
    try:
        for table in tables:
            batch = pyarrow.table(
                {
                    name: pyarrow.array(column, type=_arrow_type(name))
                    for name, column in table.items()
                }
            )
            writer = writer or pyarrow.parquet.ParquetWriter(path, batch.schema)
            writer.write_table(batch)
            rows += batch.num_rows
    finally:
        if writer is not None:
            writer.close()
    return rows


def _arrow_type(column: str) -> str:
    """Return the Arrow type of a column; needed for batches without values."""
    if column in ("events", "hold_id", "channel", "unit"):
        return "string"
    if column == "moving":
        return "bool"
    if column in ("sequence", "oversampling") or column.endswith("_counts"):
        return "int64"
    return "float64"


def solve_resistance_ohm(recording: Recording) -> FloatArray:
    """Return the pixels' resistances without crosstalk, shape (n_frames, rows, cols)."""
    return _resistance_ohm(
        recording.counts, layout=recording.info.layout, oversampling=recording.oversampling
    )


def cut_recorded_holds(
    recording: Recording, *, unit: HoldUnit = "percent", name: str = "hold"
) -> list[Hold]:
    """Cut every hold with contact and a duration of at least one second.

    A hold begins at the end of a gripper movement (time 0) and ends at the next movement. If no
    movement was recorded, contacts are found in the readings.

    `recording`: with about a second of rest before the first contact.
    `unit` ("percent" or "ohm"): change relative to the initial rest, or resistance.
    `name`: prefix of the holds' names.
    Returns for each hold the channel ``mean`` (percent only: the paper's aggregate) and a channel
    per pixel, ``r0c0`` and so on, without open pixels. Raises `RecordingError` if there is no
    initial rest, or no hold.
    """
    if len(recording.time_s) < _MIN_FRAMES:
        raise RecordingError(
            f"{len(recording.time_s)} frames are too few for holds; record at least {_MIN_FRAMES}"
        )
    ohm = solve_resistance_ohm(recording)
    reader = SampleReader(recording.info.layout, measure_rest_ohm(recording, ohm))
    change = reader.read_ohm(ohm).change_percent
    values = change if unit == "percent" else ohm
    holds: list[Hold] = []
    for number, (start_s, end_s) in enumerate(_find_still_intervals(recording, change), start=1):
        frames = _select_increasing(recording.time_s, start_s, end_s)
        touched = len(frames) >= _MIN_FRAMES and (
            np.median(largest_change(change[frames[len(frames) // 2 :]])) <= CONTACT_PERCENT
        )
        if touched:
            time_s = recording.time_s[frames] - start_s
            holds += _split_channels(f"{name}-{number}", time_s, values[frames], unit=unit)
    if not holds:
        raise RecordingError(
            f"no hold found: no contact lasted {SHORTEST_HOLD_S:g} s after a movement"
        )
    return holds


def cut_file_holds(file: Path, *, unit: HoldUnit = "percent") -> list[Hold]:
    """Cut the holds of a recording, as `cut_recorded_holds` does; the file gives them its name.

    Raises `RecordingError`, with the name of the file.
    """
    recording = load_recording(file)
    try:
        return cut_recorded_holds(recording, unit=unit, name=file.stem)
    except RecordingError as error:
        raise RecordingError(f"{file}: {error}") from error


def measure_rest_ohm(recording: Recording, ohm: FloatArray) -> FloatArray:
    """Return the rest values before the first movement, or those of the first second.

    `ohm`, shape (n_frames, rows, cols): as `solve_resistance_ohm`.
    Returns shape (rows, cols). Raises `RecordingError` if the sensor was not at rest.
    """
    moved = _find_moves(recording.gripper)
    first = int(np.argmax(moved)) if moved.any() else 0
    rest_end_s = recording.gripper.time_s[first - 1] if first else recording.time_s[0] + REST_S
    try:
        return rest_baseline(ohm[recording.time_s <= rest_end_s]).rest_ohm
    except CalibrationError as error:
        raise RecordingError(
            f"no rest at the beginning: {error}. Record a second of rest before the first contact"
        ) from error


def _find_still_intervals(recording: Recording, change: FloatArray) -> list[tuple[float, float]]:
    """Return start and end of each rest after a movement, or of each contact.

    Contacts are used if no movement was recorded.
    """
    moved, at_s = _find_moves(recording.gripper), recording.gripper.time_s
    if not moved.any():
        shown = mean_change(change)
        usable = _select_increasing(recording.time_s, -np.inf, np.inf)
        usable = usable[np.isfinite(shown[usable])]
        found = find_contacts(recording.time_s[usable], shown[usable], unit="percent")
        return [(contact.start_s, contact.end_s) for contact in found.holds]
    turns = np.flatnonzero(np.diff(moved.astype(np.int8)))
    stops = [float(at_s[k + recording.gripper.moving[k]]) for k in turns if moved[k]]
    # A frame after the last still state may have been scanned in motion.
    starts = [float(at_s[k]) for k in turns if not moved[k]]
    end_s = float(recording.time_s[-1])
    ends = [min((s for s in starts if s > stop), default=end_s) for stop in stops]
    return [
        (stop, end) for stop, end in zip(stops, ends, strict=True) if end - stop >= SHORTEST_HOLD_S
    ]


def _find_moves(gripper: GripperTrack) -> NDArray[np.bool_]:
    """Return a mask of the states in motion or with a changed position.

    At 15 frames/s, a short step may start and end between two states.
    """
    moved = gripper.moving.copy()
    for position, step in ((gripper.width_mm, _MOVED_MM), (gripper.pressure_kpa, _MOVED_KPA)):
        # A comparison with NaN (position not sensed) is False.
        moved[1:] |= np.abs(np.diff(position)) > step
    return moved


def _select_increasing(time_s: FloatArray, start_s: float, end_s: float) -> NDArray[np.intp]:
    """Return the frames from `start_s` to before `end_s`, without repeated times."""
    inside = np.flatnonzero((time_s >= start_s) & (time_s < end_s))
    keep = np.ones(len(inside), dtype=bool)
    keep[1:] = np.diff(np.maximum.accumulate(time_s[inside])) > 0
    return inside[keep]


def _split_channels(
    hold_id: str, time_s: FloatArray, values: FloatArray, *, unit: HoldUnit
) -> list[Hold]:
    columns = {
        f"r{row}c{col}": values[:, row, col]
        for row in range(values.shape[1])
        for col in range(values.shape[2])
    }
    if unit == "percent":
        columns = {"mean": mean_change(values), **columns}
    return [
        Hold(hold_id=hold_id, channel=channel, time_s=time_s, values=column, unit=unit)
        for channel, column in columns.items()
        if np.isfinite(column).all()
    ]
