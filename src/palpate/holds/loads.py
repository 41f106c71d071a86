"""Known loads: a column of newtons, grams or kilograms in a table, and lists of weights."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds.chosen_columns import has_moments
from palpate.holds.columns import (
    convert_to_seconds,
    find_clocks,
    is_index,
    is_load,
    match_name,
    scale_of,
    unit_of,
)
from palpate.holds.moments import parse_moments
from palpate.holds.table import Table
from palpate.holds.table_files import list_sheets, read_table_file, table_of_arrays
from palpate.holds.units import UNITS, find_unreadable_unit

LoadUnit: TypeAlias = Literal["N", "g", "kg"]
#: Seconds of a clock from which it counts from 1970 (a date of 1973).
_EARLIEST_UNIX_S = 1e8


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadColumn:
    """A column of loads.

    Attributes
    ----------
    name : str
        Name of the column.
    load_n : ndarray, shape (n_rows,)
        Newtons; NaN where the table has none.
    taken : str
        How the column was converted, in words.
    """

    name: str
    load_n: FloatArray
    taken: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """Weights in the order in which they were on the sensor.

    Attributes
    ----------
    load_n : ndarray, shape (n,)
        Newtons.
    clock : str or None
        Column of moments at which each was on the sensor.
    taken : str
        How the column was converted, in words.
    table : Table
        The list, without rows that have no load.
    """

    load_n: FloatArray
    clock: str | None
    taken: str
    table: Table


def find_load_column(
    table: Table, *, wanted: str | None = None, unit: LoadUnit | None = None
) -> LoadColumn | None:
    """Return the column of loads of a table; None if no column is named as a force or weight.

    `wanted`: its name. `unit`: its unit, by default that in the name.
    Raises `InputError` if there are several such columns, or the unit is unknown.

    >>> table = table_of_arrays({"R": [9.0, 5.0], "weight [g]": [0, 100]}, name="t")
    >>> find_load_column(table).load_n.round(3).tolist()
    [0.0, 0.981]
    """
    if wanted is not None:
        known = match_name(table.columns, wanted)
        if known is None:
            available = ", ".join(table.columns)[:120]
            raise InputError(f"{table.name}: no column {wanted} (available: {available})")
        found = [known]
    else:
        found = [
            name
            for name in table.numeric()
            if is_load(name) and unit_of(name) in (None, "newton") and not is_index(name)
        ]
    if wanted is None and any(_is_row_number(table, name) for name in found):
        # "n" is newtons, or the number of the row.
        found = [name for name in found if not _is_row_number(table, name)]
        if not found:
            raise InputError(
                f"{table.name}: column n may be newtons or the number of the row; say "
                "--load-column n --load-unit N, or name it number"
            )
    if not found:
        return None
    if len(found) > 1:
        raise InputError(
            f"{table.name}: {', '.join(found)} may each be the load; choose one with --load-column"
        )
    (name,) = found
    if name not in table.numeric():
        raise InputError(f"{table.name}: column {name} contains no numbers; choose another")
    factor, text = _factor_of(name, unit, where=table.name)
    taken = f"{name}: newtons" if factor == 1.0 else f"{name}: {text}, times {factor:.6g} for N"
    return LoadColumn(name=name, load_n=factor * table.columns[name], taken=taken)


def _is_row_number(table: Table, name: str) -> bool:
    numbers = table.columns[name]
    return name.lower() == "n" and bool((numbers[1:] == numbers[:-1] + 1.0).all())


def read_weights(
    source: str | os.PathLike[str] | Mapping[str, Any] | Any,
    *,
    column: str | None = None,
    unit: LoadUnit | None = None,
    sheet: str | None = None,
) -> Weights:
    """Read a list of weights: a file with a column of loads, a mapping, or newtons in order.

    A column of times says when each weight was on the sensor, on the clock of the readings.
    Raises `InputError` if the file can't be read or has no column of loads.

    >>> read_weights({"g": [50, 100]}).load_n.round(3).tolist()
    [0.49, 0.981]
    """
    if isinstance(source, str | os.PathLike):
        table = _read_weights_file(Path(source), sheet=sheet)
    elif isinstance(source, Mapping) or hasattr(source, "columns"):
        table = table_of_arrays(source, name="weights")
    else:
        table = table_of_arrays({"load_n": np.asarray(source, dtype=float)}, name="weights")
    found = find_load_column(table, wanted=column, unit=unit)
    if found is None and len(table.columns) == 1:
        found = find_load_column(table, wanted=next(iter(table.columns)), unit=unit)
    if found is None:
        available = ", ".join(table.columns)[:120]
        raise InputError(
            f"{table.name}: no column of weights recognised (available: {available}); name it "
            "load_n, weight_g or weight_kg, or choose it with --load-column"
        )
    known = np.isfinite(found.load_n)
    if (found.load_n[known] < 0).any():
        raise InputError(f"{table.name}: column {found.name} has a weight below 0; correct it")
    clocks = [name for name in find_clocks([*table.columns]) if name != found.name]
    # Of begin and end of each weight, the end.
    texts = [name for name, cells in table.columns.items() if cells.dtype == object]
    clocks += [
        name for name in texts[::-1] if name not in clocks and has_moments(table.columns[name])
    ]
    return Weights(
        load_n=found.load_n[known],
        clock=clocks[0] if clocks else None,
        taken=found.taken,
        table=replace(
            table,
            columns={name: cells[known] for name, cells in table.columns.items()},
            numbers=np.asarray(table.numbers)[known].tolist(),
        ),
    )


def _read_weights_file(path: Path, *, sheet: str | None) -> Table:
    """Return the table of a file; of a workbook without a named sheet, the first with loads."""
    table = read_table_file(path, sheet=sheet, without_clock=True)
    if sheet is None and find_load_column(table, unit="N") is None:
        for name in list_sheets(path):
            try:
                other = read_table_file(path, sheet=name, without_clock=True)
            except InputError:
                continue  # A sheet of notes.
            if find_load_column(other, unit="N") is not None:
                return replace(other, name=f"{path} sheet {name}")
    return table


def align_times_s(table: Table, clock: str, *, to: Table, to_clock: str | None) -> FloatArray:
    """Return a clock column on the clock of another table, seconds.

    Two clocks with dates, times of day or Unix times are compared. Other clocks are taken as one.
    Raises `InputError` if only one of them is absolute, or a text is not a time.

    >>> one = table_of_arrays({"time": ["12:00:00", "12:00:01"]}, name="a")
    >>> two = table_of_arrays({"time": ["12:00:00.5", "12:00:01.5"]}, name="b")
    >>> align_times_s(two, "time", to=one, to_clock="time").tolist()
    [0.5, 1.5]
    """
    time_s = convert_to_seconds(table.columns[clock], name=clock, unit=None, file=table.name)[0]
    if to_clock is None or to_clock not in to.columns:
        return time_s
    own, other = (
        _find_start(one.columns[name], name=name, file=one.name)
        for one, name in ((table, clock), (to, to_clock))
    )
    if type(own) is not type(other) or (isinstance(own, float) and (own == 0.0) != (other == 0.0)):
        raise InputError(
            f"{table.name}: column {clock} and column {to_clock} of {to.name} are different clocks "
            "(one counts from the start, or only one has dates); give both the same clock"
        )
    if isinstance(own, float) and isinstance(other, float):
        return time_s + own - other
    pair = parse_moments([other, own], name=clock, file=table.name)
    if pair is None or not np.isfinite(pair).all():
        raise InputError(f"{table.name}: column {clock}: its first time is unreadable; correct it")
    return np.asarray(time_s + pair[1])


def _find_start(column: Any, *, name: str, file: str) -> float | str:
    """Return the first time: seconds that the conversion takes off, or the text of a moment."""
    if column.dtype == object:
        return str(next((cell for cell in column.tolist() if str(cell).strip()), ""))
    if column.dtype.kind in "mM":
        return str(column[np.argmin(np.isnat(column))].astype("datetime64[us]"))
    time_s = convert_to_seconds(column, name=name, unit=None, file=file)[0]
    known = np.flatnonzero(np.isfinite(time_s))
    first, last = known[0], known[-1]
    if time_s[first] != 0.0 or time_s[last] == 0.0:
        return 0.0
    start_s = column[first] * (time_s[last] - time_s[first]) / (column[last] - column[first])
    return float(start_s) if start_s >= _EARLIEST_UNIX_S else 0.0


def _factor_of(name: str, stated: LoadUnit | None, *, where: str) -> tuple[float, str]:
    """Return the newtons of one unit of a column, and the unit in words."""
    if stated is not None:
        return UNITS[stated][1], stated
    unreadable = find_unreadable_unit(name)
    if unreadable is not None:
        raise InputError(
            f"{where}: column {name}: loads in {unreadable!a} can't be converted; convert them, or "
            "give --load-unit N, g or kg"
        )
    if unit_of(name) != "newton":
        raise InputError(
            f"{where}: column {name} has no unit; give --load-unit N, g or kg, or name it load_n, "
            "load_g or load_kg"
        )
    return scale_of(name), "by the unit in its name"
