"""Rows that belong together: sensors in separate rows, frames in several lines, repeated times.

A table may have one row per sensor and time, named by a column (``time,sensor,value``), or one line
per reading, in the order of the sensors. Only repeated readings of one sensor may be averaged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.columns import names_sensor
from palpate.holds.table import Table, label_text

#: Most sensors in separate rows, and fewest rows of each.
_MOST_SENSORS, _FEWEST_ROWS = 256, 5
#: Fraction of rows that must follow a pattern.
_MOST = 0.9
#: Places of a frame hold different sensors if their difference has one sign this often, and is this
#: many times larger than the change from time to time.
_ONE_SIGN, _TIMES_LARGER = 0.9, 3.0
#: Repeated readings that differ by more than this fraction of the range are not of one sensor.
_DIFFERENT = 0.1
#: Most sensors whose alternating readings are recognised.
_MOST_INTERLEAVED = 16
#: Most lines of a frame that are recognised by the lines between frames, and fewest lines of a file
#: in half as many frames.
_MOST_BLOCK_ROWS, _FEWEST_BLOCK_LINES = 64, 20
#: Rows of one time from which a clock is called coarse.
_SPREAD_ROWS = 3
#: A clock restarts if it falls below this fraction of its last value, or to its first value; and
#: this many rows may be between two restarts at least.
_RESTART_FRACTION, _FEWEST_PART_ROWS = 0.5, 3

#: A clock change, and the slowest readings with which a pause of an hour isn't taken for one.
_HOUR_S, _SLOWEST_S = 3600.0, 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Rows of one recording, with a column per sensor."""

    #: Shape (n_rows,). Seconds, not decreasing.
    time_s: NDArray[np.float64]
    #: By name, shape (n_rows,). Readings; NaN where a row has none.
    columns: dict[str, NDArray[np.float64]]
    #: One sentence for each assumption.
    remarks: list[str] = field(default_factory=list)


def find_sensor_column(
    time_s: NDArray[np.float64], texts: Mapping[str, NDArray[Any]]
) -> str | None:
    """Return the name of the column that names each row's sensor, if any.

    `texts`: columns of labels, and of numbers whose names suggest a sensor's number.

    >>> time_s = np.repeat(np.arange(10.0), 2)
    >>> find_sensor_column(time_s, {"which": np.array(["left", "right"] * 10, object)})
    'which'
    """
    for name, cells in texts.items():
        labels = cells.astype(str)
        counts = np.unique(labels, return_counts=True)[1]
        if not 2 <= counts.size <= _MOST_SENSORS or counts.min() < _FEWEST_ROWS:
            continue
        if names_sensor(name) and cells.dtype == object:
            return name
        known = np.isfinite(time_s)
        pairs = {*zip(time_s[known].tolist(), labels[known].tolist(), strict=True)}
        is_unique = len(pairs) >= _MOST * known.sum()
        alternates = names_sensor(name) and np.mean(labels[1:] != labels[:-1]) > _MOST
        if is_unique and (alternates or np.unique(time_s[known]).size < 0.6 * known.sum()):
            return name
        # The numbers of sensors follow each other in one order.
        period = counts.size
        cycles = np.mean(labels[period:] == labels[:-period]) > _MOST
        if name.isdigit() and cycles and np.mean(labels[1:] != labels[:-1]) > _MOST:
            return name
    return None


def split_by_label(
    time_s: NDArray[np.float64],
    columns: Mapping[str, NDArray[np.float64]],
    labels: NDArray[Any],
    *,
    column: str,
    where: str,
) -> Frames:
    """Return a column for each sensor, in the order of time.

    `labels`, shape (n_rows,): sensor of each row, from the table's `column`.
    Raises `InputError` if the times of one sensor decrease.
    """
    names = [label_text(label) for label in labels.tolist()]
    each = np.array(names, dtype=object)
    order = np.argsort(time_s, kind="stable")
    found: dict[str, NDArray[np.float64]] = {}
    for label in dict.fromkeys(names):
        mine = each == label
        times = time_s[mine & np.isfinite(time_s)]
        if (np.diff(times) < 0).any():
            raise InputError(
                f"{where}: time decreases in the rows of {column} {label}; sort the rows by time, "
                "or save each recording as its own file"
            )
        for name, values in columns.items():
            full = f"{label}" if len(columns) == 1 else f"{name} {label}"
            found[full] = np.where(mine, values, np.nan)[order]
    return Frames(
        time_s=time_s[order],
        columns=found,
        remarks=[f"the rows belong to {len({*names})} sensors, named in column {column}"],
    )


def split_frames(
    time_s: NDArray[np.float64], columns: Mapping[str, NDArray[np.float64]], *, where: str
) -> Frames:
    """Return a column for each place of a frame whose readings are in separate rows.

    Frames are rows between markers (an absent reading or -1 in every k-th row), or rows of one
    time.

    Raises `InputError` if rows of one time have different readings, but no constant number.
    """
    plain = Frames(time_s=time_s, columns=dict(columns))
    if len(columns) == 1:
        (name,) = columns
        marked = _split_at_markers(time_s, columns[name])
        if marked is not None:
            return marked
        if (np.diff(time_s) > 0).all():
            _check_interleaved(columns[name], name=name, where=where)
    is_new = np.diff(time_s, prepend=-np.inf) > 0
    if is_new.mean() > 1.0 - _DIFFERENT:
        return plain
    starts = np.flatnonzero(is_new)
    sizes = np.diff(starts, append=time_s.size)
    size = int(np.bincount(sizes).argmax())
    regular = starts[sizes == size]
    if size > 1 and regular.size >= _MOST * starts.size and regular.size >= _FEWEST_ROWS:
        grids = {n: values[regular[:, None] + np.arange(size)] for n, values in columns.items()}
        if any(_is_of_several(grid) for grid in grids.values()):
            found = {}
            for name, grid in grids.items():
                for place in range(size):
                    full = f"place {place + 1}" if len(grids) == 1 else f"{name} place {place + 1}"
                    if np.ptp(grid[:, place]) > 0 or len(grids) > 1:
                        found[full] = grid[:, place]
            return Frames(
                time_s=time_s[regular],
                columns=found,
                remarks=_describe(size, len(found), left_out=starts.size - regular.size),
            )
        return plain
    number = np.cumsum(is_new) - 1
    for name, values in columns.items():
        if _differs_within(values, number):
            raise InputError(
                f"{where}: rows with the same time have different readings in {name}, but not "
                "always the same number of them; add a column with the name of the sensor, or "
                "write the readings of one time in one row"
            )
    return plain


def _describe(size: int, sensors: int, *, left_out: int) -> list[str]:
    remark = f"each time has {size} rows; {sensors} of them vary and are read as sensors, by place"
    return [remark + (f" ({left_out} times with other numbers were omitted)" if left_out else "")]


def _split_at_markers(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> Frames | None:
    for marker, what in _find_markers(values):
        places = np.flatnonzero(marker)
        strides = np.diff(places)
        if places.size < _FEWEST_ROWS:
            continue
        stride = int(np.median(strides))
        regular = places[:-1][strides == stride]
        is_whole = places.size * stride >= _MOST * values.size
        if stride < 2 or regular.size < _MOST * strides.size or not is_whole:
            continue
        if places[-1] + stride <= values.size:
            regular = np.append(regular, places[-1])
        grid = values[regular[:, None] + np.arange(1, stride)]
        is_number = np.isfinite(values[places[0]]) and stride <= _MOST_INTERLEAVED
        if stride > 2 and not is_number and not _is_rougher_within(grid):
            # One sensor whose log has regular remarks.
            continue
        names = ["value"] if stride == 2 else [f"place {k + 1}" for k in range(stride - 1)]
        return Frames(
            time_s=time_s[regular + 1],
            columns=dict(zip(names, grid.T, strict=True)),
            remarks=[
                f"{what} separates the frames; the {stride - 1} readings of a frame are read as "
                "sensors, by place"
            ],
        )
    return None


def _is_rougher_within(grid: NDArray[np.float64]) -> bool:
    """Return whether readings change more from place to place than from frame to frame."""
    within = np.nanmedian(np.abs(np.diff(grid, axis=1)))
    return bool(within > _TIMES_LARGER * np.nanmedian(np.abs(np.diff(grid, axis=0))))


def _find_markers(values: NDArray[np.float64]) -> list[tuple[NDArray[np.bool_], str]]:
    """Return masks of rows that may separate frames, and their description."""
    known = np.isfinite(values)
    found = [(~known, "a row without a reading")]
    for end in (np.min, np.max):
        odd = float(end(values[known], initial=np.inf if end is np.min else -np.inf))
        others = values[known & (values != odd)]
        if others.size and np.min(np.abs(others - odd)) > _DIFFERENT * float(np.ptp(others)):
            found.append((values == odd, f"a row with {odd:g}"))
    return found


def _check_interleaved(values: NDArray[np.float64], *, name: str, where: str) -> None:
    """Raise `InputError` if readings alternate, as of several sensors in one column."""
    known = values[np.isfinite(values)]
    if known.size < 4 * _MOST_INTERLEAVED:
        return
    low, high = np.quantile(known, [0.01, 0.99])
    step = float(np.median(np.abs(np.diff(known))))
    if step <= _DIFFERENT * (high - low):
        return
    for count in range(2, _MOST_INTERLEAVED + 1):
        if np.median(np.abs(known[count:] - known[:-count])) < 0.2 * step:
            raise InputError(
                f"{where}: the readings in {name} alternate like {count} sensors in one column; "
                "add a column with the sensor's name, or write the readings of one time in one row"
            )


def _is_of_several(grid: NDArray[np.float64]) -> bool:
    """Return whether the places of frames hold different sensors.

    `grid`, shape (n_times, n_places).
    """
    first = grid[:, 0]
    change = np.abs(np.diff(first[np.isfinite(first)]))
    usual = float(np.median(change)) if change.size else 0.0
    for place in range(1, grid.shape[1]):
        apart = grid[:, place] - first
        apart = apart[np.isfinite(apart) & (apart != 0)]
        if apart.size < 0.1 * first.size or apart.size < _FEWEST_ROWS:
            continue
        sign = max((apart > 0).mean(), (apart < 0).mean())
        if sign >= _ONE_SIGN and np.median(np.abs(apart)) > _TIMES_LARGER * usual:
            return True
    return _differs_within(grid.ravel(), np.repeat(np.arange(len(grid)), grid.shape[1]))


def _differs_within(values: NDArray[np.float64], number: NDArray[np.intp]) -> bool:
    """Return whether most readings of one time differ by a large part of the range."""
    known = np.isfinite(values)
    if known.sum() < _FEWEST_ROWS:
        return False
    values, number = values[known], number[known]
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    several = np.diff(starts, append=number.size) > 1
    if not several.any():
        return False
    spread = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
    low, high = np.quantile(values, [0.01, 0.99])
    return bool(high > low and np.median(spread[several]) > _DIFFERENT * (high - low))


def join_clock_change(
    time_s: NDArray[np.float64], places: Sequence[str], *, remarks: list[str]
) -> NDArray[np.float64]:
    """Return times of day without the hour that the clock was set back or forward.

    >>> join_clock_change(np.array([0, 1, 2, -3597, -3596.0]), ["line"] * 5, remarks=[]).tolist()
    [0.0, 1.0, 2.0, 3.0, 4.0]
    """
    steps = np.diff(time_s)
    usual = float(np.median(np.abs(steps))) if steps.size else 0.0
    if not 0.0 < usual <= _SLOWEST_S:
        return time_s
    hours = np.sign(steps) * (np.abs(np.abs(steps - usual) - _HOUR_S) <= 2.0 * usual)
    if not hours.any():
        return time_s
    row = int(np.flatnonzero(hours)[0]) + 1
    remarks.append(f"the clock was changed by an hour at {places[row]}; the times continue there")
    return time_s - _HOUR_S * np.concatenate(([0.0], np.cumsum(hours)))


def split_restarts(
    time_s: NDArray[np.float64],
    places: Sequence[str],
    *,
    is_date: bool,
    where: str,
    remarks: list[str],
) -> list[tuple[str, slice]]:
    """Return the name and rows of each stretch between restarts of a clock.

    `is_date`: dates and times of day don't restart.
    Raises `InputError` if time decreases otherwise.
    """
    back = (np.flatnonzero(np.diff(time_s) < 0) + 1).tolist()
    starts, ends = [0, *back], [*back, time_s.size]
    for row, start, end in zip(back, starts[:-1], ends[1:], strict=True):
        before = float(time_s[row - 1])
        restarts = time_s[row] <= max(_RESTART_FRACTION * before, float(time_s[start]))
        if is_date or not restarts or min(row - start, end - row) < _FEWEST_PART_ROWS:
            raise InputError(
                f"{where} {places[row]}: time decreases ({before:g} s, then {time_s[row]:g} s); "
                "sort the rows, or save each recording as its own file"
            )
    if back:
        listed = ", ".join(places[row] for row in back[:3])
        remarks.append(
            f"the clock restarts at {listed}; the {len(starts)} parts are recordings of their own"
        )
    return [
        (f"part {number}" if back else "", slice(start, end))
        for number, (start, end) in enumerate(zip(starts, ends, strict=True), start=1)
    ]


def check_blocks(table: Table) -> None:
    """Raise `InputError` if empty lines separate frames of several lines."""
    numbers = np.asarray(table.numbers)
    if table.word != "line" or numbers.size < 2 * _FEWEST_BLOCK_LINES:
        return
    begins = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 2) > 1)
    sizes = np.diff(begins)
    size = int(np.median(sizes)) if sizes.size else 0
    if not 2 <= size <= _MOST_BLOCK_ROWS or sizes.size < _FEWEST_BLOCK_LINES // 2:
        return
    gaps = np.diff(numbers)[begins[1:] - 1]
    if (sizes == size).mean() > 0.9 and (gaps == np.median(gaps)).mean() > 0.9:
        raise InputError(
            f"{table.name}: other lines separate blocks of {size} lines of readings, like frames; "
            "write the readings of a frame in one line"
        )


def merge_repeats(
    frames: Frames, *, remarks: list[str]
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Return distinct times and the readings at each.

    Rows that repeat a time are averaged, or spread over the tick of a coarse clock.
    """
    time_s = frames.time_s
    is_new = np.diff(time_s, prepend=-np.inf) > 0
    # Sensors in separate rows share a time without repeating it.
    most = max((_count_most(values, is_new) for values in frames.columns.values()), default=1)
    if most >= _SPREAD_ROWS:
        time_s = _spread_over_ticks(time_s, is_new, rows=most)
        is_new = np.diff(time_s, prepend=-np.inf) > 0
        remarks.append(
            f"the clock is coarse: {most} rows have the same time and are spread over its tick"
        )
    elif most > 1:
        remarks.append(
            f"{int((~is_new).sum())} rows repeat the previous time; their readings were averaged"
        )
    order = np.cumsum(is_new) - 1
    readings = {name: _average_repeats(values, order) for name, values in frames.columns.items()}
    return time_s[is_new], readings


def _count_most(values: NDArray[np.float64], is_new: NDArray[np.bool_]) -> int:
    """Return how many readings a time has, or 2 if few times repeat."""
    counts = np.bincount((np.cumsum(is_new) - 1)[~np.isnan(values)])
    counts = counts[counts > 0]
    if not counts.size:
        return 1
    usual = int(np.median(counts))
    return usual if usual > 1 else min(2, int(counts.max()))


def _spread_over_ticks(
    time_s: NDArray[np.float64], is_new: NDArray[np.bool_], *, rows: int
) -> NDArray[np.float64]:
    """Return times spread over the ticks of a coarse clock.

    The recording begins and ends within a tick: the first rows are at the end of theirs.
    """
    starts = np.flatnonzero(is_new)
    counts = np.diff(starts, append=time_s.size)
    ticks = time_s[starts]
    tick_s = float(np.median(np.diff(ticks))) if ticks.size > 1 else 1.0
    number = np.cumsum(is_new) - 1
    place = np.arange(time_s.size) - starts[number]
    in_tick = np.maximum(counts, rows)[number]
    place = place + np.where(number == 0, in_tick - counts[0], 0)
    return np.asarray(time_s + tick_s * place / in_tick)


def _average_repeats(column: NDArray[np.float64], order: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the mean at each time; infinity or NaN without a finite reading."""
    use = np.isfinite(column)
    size = int(order.max(initial=-1)) + 1
    counts = np.bincount(order[use], minlength=size)
    sums = np.bincount(order[use], weights=column[use], minlength=size)
    means = np.full(size, np.nan)
    means[order[column == np.inf]] = np.inf
    np.divide(sums, counts, out=means, where=counts > 0)
    return means
