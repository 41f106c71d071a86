"""Rows that belong together: sensors in separate rows, frames in several lines, repeated times.

A table may have one row per sensor and time, named by a column (``time,sensor,value``), or one line
per reading, in the order of the sensors. Only repeated readings of one sensor may be averaged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.columns import names_sensor

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
    names = [_plain(label) for label in labels.tolist()]
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


def _plain(label: object) -> str:
    return f"{label:.0f}" if isinstance(label, float) and label.is_integer() else str(label).strip()


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
            time_s=time_s[regular],
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
