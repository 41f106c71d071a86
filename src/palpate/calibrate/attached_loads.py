"""Loads of a load cell's file, and of a list of weights, attached to readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.calibrate.loaded_sensor import LoadedPart, LoadedSensor
from palpate.errors import InputError
from palpate.holds.cutting import cut_columns
from palpate.holds.loads import LoadUnit, Weights, align_times_s, find_load_column
from palpate.holds.recordings import ReadingTable, find_clock
from palpate.holds.table import Table

#: The reading under a weight is the median of this time, which ends this long before the weight is
#: lifted, because a hand on the weight changes the reading (a second of the 20 s that a sheet needs
#: to settle; `contacts.OPENING_S`).
_WINDOW_S, _LIFTING_S = 1.0, 0.1
#: A time that a person notes is this near to the hold, seconds.
_NOTED_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadCell:
    """The loads of a load cell on the clock of the readings, each of shape (n,)."""

    name: str
    time_s: FloatArray
    load_n: FloatArray
    taken: str


def read_cell(table: Table, *, unit: LoadUnit | None, to: Table, to_clock: str | None) -> LoadCell:
    """Return the loads of a table on the clock of the readings.

    Raises `InputError` if it has no column of loads or of times, or the clocks differ.
    """
    found = find_load_column(table, unit=unit)
    if found is None:
        available = ", ".join(table.columns)[:120]
        raise InputError(
            f"{table.name}: no column of loads (available: {available}); name it load_n"
        )
    clock = find_clock(
        replace(table, columns={k: c for k, c in table.columns.items() if k != found.name})
    )
    if clock is None:
        raise InputError(
            f"{table.name}: a load cell needs a column of times; without times it is a list of "
            "weights (--weights)"
        )
    time_s = align_times_s(table, clock, to=to, to_clock=to_clock)
    known = np.isfinite(time_s) & np.isfinite(found.load_n)
    if (np.diff(time_s[known]) < 0).any():
        raise InputError(f"{table.name}: time decreases in column {clock}; sort the rows")
    return LoadCell(
        name=table.name,
        time_s=time_s[known],
        load_n=found.load_n[known],
        taken=f"{found.taken}, interpolated from {table.name}",
    )


def add_cell(sensor: LoadedSensor, cell: LoadCell, *, where: str) -> LoadedSensor:
    """Return the readings with the loads of a load cell."""
    if len(sensor.parts) > 1:
        raise InputError(
            f"{where}: it has {len(sensor.parts)} recordings; split it for --load-cell"
        )
    (part,) = sensor.parts
    load_n = np.interp(part.time_s, cell.time_s, cell.load_n, left=np.nan, right=np.nan)
    if not np.isfinite(load_n).any():
        raise InputError(
            f"{cell.name}: its times, {cell.time_s[0]:g} to {cell.time_s[-1]:g} s, are not those "
            f"of the readings, {part.time_s[0]:g} to {part.time_s[-1]:g} s; use the same clock"
        )
    return replace(sensor, parts=(replace(part, load_n=load_n),))


def add_weights(
    sensor: LoadedSensor, listed: Weights, *, table: Table, clock: str | None
) -> LoadedSensor:
    """Return the readings with the moments of the weights: by their times, or in order of holds."""
    if len(sensor.parts) > 1:
        raise InputError(
            f"{table.name}: it has {len(sensor.parts)} recordings; split it for --weights"
        )
    (part,) = sensor.parts
    if listed.clock is not None:
        time_s = align_times_s(listed.table, listed.clock, to=table, to_clock=clock)
        in_holds = _find_noted_ends(sensor, part, time_s, is_laid=listed.load_n > 0)
        ends = time_s if in_holds is None else in_holds
        noted = f"its time in column {listed.clock}"
        how = f"the second up to {noted}"
        if in_holds is not None:
            how = f"the last second of the hold at {noted}"
    else:
        ends = _find_hold_ends(sensor, part)
        loads = listed.load_n[listed.load_n > 0]
        if ends.size != loads.size:
            found = ", ".join(f"{end:.4g}" for end in ends[:12])
            raise InputError(
                f"{table.name}: {loads.size} weights above 0, but {ends.size} holds were found"
                f"{f', which end at {found} s' if found else ''}; list each weight once in order, "
                "or add a column time_s with a moment of each weight"
            )
        listed = replace(listed, load_n=loads)
        how = "the last second of its hold"
    weighed = []
    for end_s, load_n in zip(ends.tolist(), listed.load_n.tolist(), strict=True):
        inside = (part.time_s >= end_s - _WINDOW_S) & (part.time_s <= end_s)
        if not inside.any():
            raise InputError(
                f"{table.name}: no reading in the second before {end_s:g} s, when {load_n:g} N was "
                "on the sensor; correct the time of this weight"
            )
        weighed.append((end_s - _WINDOW_S, end_s, load_n))
    text = f"reading under each weight: median of {how}"
    return replace(
        sensor, parts=(replace(part, weighed=tuple(weighed)),), taken=[*sensor.taken, text]
    )


def _find_noted_ends(
    sensor: LoadedSensor, part: LoadedPart, time_s: FloatArray, *, is_laid: NDArray[np.bool_]
) -> FloatArray | None:
    """Return the ends of the holds at noted times; None unless each weight has a hold of its own.

    A time is noted when a weight is laid, read or lifted.
    """
    spans, ends = np.array(_find_spans(sensor, part)).reshape(-1, 2), time_s.copy()
    used = set[int]()
    for row in np.flatnonzero(is_laid):
        away_s = np.maximum(spans[:, 0] - time_s[row], time_s[row] - spans[:, 1])
        nearest = int(np.argmin(away_s)) if away_s.size else -1
        if nearest in {*used, -1} or away_s[nearest] > _NOTED_S:
            return None
        used.add(nearest)
        ends[row] = spans[nearest, 1] - _LIFTING_S
    return ends


def _find_hold_ends(sensor: LoadedSensor, part: LoadedPart) -> FloatArray:
    """Return the time before the end of each hold, seconds."""
    return np.array([end_s - _LIFTING_S for _, end_s in _find_spans(sensor, part)])


def _find_spans(sensor: LoadedSensor, part: LoadedPart) -> list[tuple[float, float]]:
    """Return begin and end of each hold of the column with the most holds, seconds."""
    recorded = ReadingTable(
        name=part.name,
        time_s=part.time_s,
        columns={name: part.values[:, at] for at, name in enumerate(sensor.columns)},
        units=dict.fromkeys(sensor.columns, sensor.unit),
    )
    return max((one.spans for one in cut_columns(recorded)), key=len)
