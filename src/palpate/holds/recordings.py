"""A recording of anybody's: its clock in seconds, and the readings of its sensors."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.columns import (
    TimeUnit,
    Unit,
    find_clock,
    find_part,
    find_readings,
    is_moment,
    scale_of,
    seconds,
    time_unit_of,
    unit_of,
)
from palpate.holds.table import Table, refuse_or_report, runs_of
from palpate.holds.table_files import read_table_file, table_of_arrays
from palpate.signal.circuit import Divider, resistance_ohm
from palpate.signal.relative import mean_change

#: Name of the column of the mean of relative changes.
MEAN = "mean change"
#: Fewest readings at rest of each column.
_FEWEST_AT_REST = 3
#: Longest ending first: of ``log.csv.gz`` the stem is ``log``.
_ENDINGS = (".gz", ".csv", ".tsv", ".txt", ".dat", ".log", ".xlsx", ".xlsm", ".parquet", ".pq")


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """A recording: readings of one or more sensors on one clock.

    Attributes
    ----------
    name : str
        What its holds' names begin with: the file's name without its ending.
    time_s : ndarray, shape (n_times,)
        Strictly increasing, seconds.
    columns : mapping of str to ndarray, shape (n_times,)
        Readings by column; NaN where missing.
    units : mapping of str to str or None
        ``ohm``, ``percent``, ``counts``, ``volt``, ``newton``, ``pascal``, or None where it isn't
        known. Prefixes are converted: readings in ``kOhm`` are here in ohm.
    divider : Divider or None
        What turns counts into ohm.
    is_hold : bool
        Whether it is one hold already: the table had a column ``hold_id``.
    remarks : list of str
        Omissions and assumptions, one sentence each.
    """

    name: str
    time_s: NDArray[np.float64]
    columns: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, Unit | None]
    divider: Divider | None = None
    is_hold: bool = False
    remarks: list[str] = field(default_factory=list)


def read_recording(
    source: str | os.PathLike[str] | Mapping[str, Any] | Any,
    *,
    time_column: str | None = None,
    time_unit: TimeUnit | None = None,
    value_columns: Sequence[str] = (),
    unit: Unit | None = None,
    divider: Divider | None = None,
) -> Readings:
    """Read one recording from a file, from arrays by name or from a pandas DataFrame.

    Parameters
    ----------
    source : path, mapping of str to array_like, or DataFrame
        CSV, TSV and other text tables, gzipped or not, .xlsx, or Parquet.
    time_column : str, optional
        The clock; recognised by usual names (``time``, ``t``, ``timestamp``, ``ms``, ...).
    time_unit : {"s", "ms", "us", "unix"}, optional
        Of numbers in it; found from the column's name, or from what a recording's times can be.
    value_columns : sequence of str, optional
        The sensors; recognised by usual names (``resistance``, ``A0``, ``value``, ...).
    unit : {"ohm", "percent", "counts", "volt"}, optional
        Of all value columns; found from their names.
    divider : Divider, optional
        Circuit that counts were read through. `cut_holds` gives ohm then.

    Raises
    ------
    InputError
        If there is no such file or table, a column isn't found, or time goes backwards.
    MissingExtraError
        If the file's form needs an extra that isn't installed.

    Examples
    --------
    >>> found = read_recording({"ms": [0, 20, 40], "A0": [12, 700, 710], "force_n": [0, 2, 2]})
    >>> found.time_s.tolist(), list(found.columns), found.units["A0"]
    ([0.0, 0.02, 0.04], ['A0'], 'counts')
    """
    parts = read_recordings(
        source,
        time_column=time_column,
        time_unit=time_unit,
        value_columns=value_columns,
        unit=unit,
        divider=divider,
    )
    if len(parts) > 1:
        raise InputError(
            f"{parts[0].name}: one of {len(parts)} recordings in a table; `cut_holds` takes such a "
            "table whole"
        )
    return parts[0]


def read_recordings(
    source: Any,
    *,
    time_column: str | None = None,
    time_unit: TimeUnit | None = None,
    value_columns: Sequence[str] = (),
    unit: Unit | None = None,
    divider: Divider | None = None,
) -> list[Readings]:
    """Read all recordings of a table: several where a column ``recording_id`` separates them."""
    table, stem = _table(source)
    if time_unit not in (None, *get_args(TimeUnit)) or unit not in (None, *get_args(Unit)):
        raise InputError(f"{table.name}: time_unit {time_unit}, unit {unit}: no such unit")
    clock = _clock(table, time_column)
    values = _values(table, clock, value_columns)
    found: list[Readings] = []
    for label, rows in _parts(table):
        remarks = list(table.left_out) if not found else []
        where = f"{table.name} {label}".strip()
        raw_s, taken = seconds(table.columns[clock][rows], name=clock, unit=time_unit, file=where)
        if taken != "s" and time_unit is None and time_unit_of(clock) == "":
            remarks.append(f"times in {clock} are taken as {taken}; --time-unit changes that")
        time_s, order = _order_times(raw_s, rows, table, clock, where=where, remarks=remarks)
        columns = {name: _average_repeats(table.columns[name][rows], order) for name in values}
        units: dict[str, Unit | None] = {name: unit or unit_of(name) for name in values}
        for name in values:
            if unit is None and scale_of(name) != 1.0:
                columns[name] = scale_of(name) * columns[name]
                remarks.append(f"{name} is converted to {units[name]}; --unit changes that")
        found.append(
            Readings(
                name=f"{stem}:{label}" if label else stem,
                is_hold="hold_id" in table.columns,
                time_s=time_s,
                columns=columns,
                units=units,
                divider=divider,
                remarks=remarks,
            )
        )
    return found


def _table(source: Any) -> tuple[Table, str]:
    """Return the table of a source and the stem of its name."""
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        stem = path.name
        while Path(stem).suffix.lower() in _ENDINGS:
            stem = Path(stem).stem
        return read_table_file(path), stem
    if not isinstance(source, Mapping) and not hasattr(source, "columns"):
        raise InputError(
            f"a recording can't be a {type(source).__name__}; give a file, arrays by name or a "
            "data frame"
        )
    return table_of_arrays(source, name="recording"), "recording"


def _clock(table: Table, wanted: str | None) -> str:
    has = ", ".join(table.columns)[:120]
    if wanted is not None:
        if wanted not in table.columns:
            raise InputError(f"{table.name}: no column {wanted} (it has: {has})")
        return wanted
    named = find_clock(list(table.columns))
    if named is not None:
        return named
    moments = [
        name
        for name, column in table.columns.items()
        if column.dtype.kind in "mM" or (column.dtype == object and is_moment(column[0]))
    ]
    if moments:
        return moments[0]
    first = next(iter(table.columns))
    numbers = table.columns[first]
    # Without a header the clock is the first column, if it could be one.
    if first == "1" and numbers.dtype == np.float64 and not (np.diff(numbers) < 0).any():
        return first
    raise InputError(
        f"{table.name}: which column is the time? Name it with --time-column (it has: {has})"
    )


def _values(table: Table, clock: str, wanted: Sequence[str]) -> list[str]:
    has = ", ".join(name for name in table.columns if name != clock)[:120]
    for name in wanted:
        if name not in table.columns:
            raise InputError(f"{table.name}: no column {name} (it has: {has})")
        if name not in table.numeric():
            raise InputError(f"{table.name}: column {name} has no numbers in it; name another")
    numeric = [name for name in table.numeric() if name not in (clock, find_part([name]))]
    found = list(dict.fromkeys(wanted)) or find_readings(numeric)
    if not found:
        raise InputError(f"{table.name}: no column of readings next to {clock} (it has: {has})")
    return found


def _parts(table: Table) -> list[tuple[str, slice]]:
    """Return label and rows of each recording of a table."""
    part = find_part(list(table.columns))
    if part is None:
        return [("", slice(0, table.rows))]
    labels = np.array([_label(cell) for cell in table.columns[part].tolist()], dtype=object)
    runs = runs_of(labels)
    return [(labels[rows.start] if len(runs) > 1 else "", rows) for rows in runs]


def _label(cell: object) -> str:
    """Return a label as text; a table of numbers has whole ones as 1.0 too."""
    return f"{cell:.0f}" if isinstance(cell, float) and cell.is_integer() else str(cell)


def _order_times(
    raw_s: NDArray[np.float64],
    rows: slice,
    table: Table,
    clock: str,
    *,
    where: str,
    remarks: list[str],
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return distinct times, and for each row which of them it has (-1: none)."""
    known = np.flatnonzero(np.isfinite(raw_s))
    bad = np.flatnonzero(~np.isfinite(raw_s))
    remarks += refuse_or_report(
        [(table.place(rows.start + int(row)), f"no time in column {clock}") for row in bad],
        total=raw_s.size,
        name=where,
    )
    time_s = raw_s[known]
    back = np.flatnonzero(np.diff(time_s) < 0)
    if back.size:
        row = rows.start + int(known[back[0] + 1])
        raise InputError(
            f"{where} {table.place(row)}: time goes backwards ({time_s[back[0]]:g} s, then "
            f"{time_s[back[0] + 1]:g} s); sort the rows, or save each recording as its own file"
        )
    fresh = np.diff(time_s, prepend=-np.inf) > 0
    if not fresh.all():
        remarks.append(f"{int((~fresh).sum())} rows repeat the time before; they were averaged")
    order = np.full(raw_s.size, -1, dtype=np.intp)
    order[known] = np.cumsum(fresh) - 1
    return time_s[fresh], order


def _average_repeats(column: NDArray[np.float64], order: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the mean of the readings of each time; NaN where it has none."""
    use = (order >= 0) & np.isfinite(column)
    size = int(order.max(initial=-1)) + 1
    counts = np.bincount(order[use], minlength=size)
    sums = np.bincount(order[use], weights=column[use], minlength=size)
    means = np.full(size, np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return means


def relative_readings(readings: Readings, *, rest_s: tuple[float, float], mean: bool) -> Readings:
    """Return a recording as relative changes, percent: of each column, or their mean.

    Parameters
    ----------
    readings : Readings
        In ohm, or in counts with their divider; a unit that isn't known is taken as ohm.
    rest_s : tuple of float
        Beginning and end of a stretch without load, seconds of the recording.
    mean : bool
        Whether to take the mean over all columns (section 2.1). A reading that is missing or open
        is left out of it.

    Raises
    ------
    InputError
        If a column is in another unit, or does not read at rest.

    Examples
    --------
    >>> table = {"time_s": [0, 1, 2, 3], "a": [10, 10, 10, 5.0], "b": [20, 20, 20, 20.0]}
    >>> changed = relative_readings(read_recording(table), rest_s=(0, 2), mean=True)
    >>> changed.columns["mean change"].tolist()
    [0.0, 0.0, 0.0, -25.0]
    """
    begin_s, end_s = rest_s
    at_rest = (readings.time_s >= begin_s) & (readings.time_s <= end_s)
    changes = dict[str, NDArray[np.float64]]()
    for name in readings.columns:
        ohm = _ohm(readings, name)
        rest = ohm[at_rest & np.isfinite(ohm) & (ohm > 0)]
        if rest.size < _FEWEST_AT_REST:
            raise InputError(
                f"{readings.name}: {name}: {rest.size} readings at rest from {begin_s:g} to "
                f"{end_s:g} s, and {_FEWEST_AT_REST} are needed; give another --rest or leave the "
                "column out (--value-column)"
            )
        change = 100.0 * (ohm / np.mean(rest) - 1.0)
        changes[name] = np.where(np.isfinite(change), change, np.nan)
    columns: Mapping[str, NDArray[np.float64]] = changes
    if mean:
        together = np.stack(list(changes.values()), axis=-1)
        columns = {MEAN: np.asarray(mean_change(together[:, None, :]))}
    return replace(readings, columns=columns, units=dict.fromkeys(columns, "percent"), divider=None)


def _ohm(readings: Readings, name: str) -> NDArray[np.float64]:
    unit, values = readings.units[name], readings.columns[name]
    if unit == "counts" and readings.divider is not None:
        return np.asarray(resistance_ohm(values, divider=readings.divider))
    if unit not in (None, "ohm"):
        remedy = "; add --adc-bits, --reference-ohm and --sensor-leg" if unit == "counts" else ""
        raise InputError(
            f"{readings.name}: {name}: --rest converts ohm to relative changes, and this is {unit}"
            + remedy
        )
    return values
