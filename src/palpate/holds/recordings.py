"""Recordings from any logger: a clock in seconds and sensor readings."""

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
    convert_to_seconds,
    find_clock,
    find_readings,
    find_recording_column,
    is_moment,
    scale_of,
    time_unit_of,
    unit_of,
)
from palpate.holds.table import Table, find_runs, report_bad_rows
from palpate.holds.table_files import read_table_file, table_of_arrays
from palpate.signal.circuit import Divider, resistance_ohm
from palpate.signal.relative import mean_change

#: Name of the column with the mean of the relative changes.
MEAN_COLUMN = "mean change"
#: Minimum readings at rest in each column.
_MIN_REST_READINGS = 3
#: Extensions, removed repeatedly, so the stem of ``log.csv.gz`` is ``log``.
_ENDINGS = (".gz", ".csv", ".tsv", ".txt", ".dat", ".log", ".xlsx", ".xlsm", ".parquet", ".pq")


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """A recording: readings of one or more sensors on one clock.

    Attributes
    ----------
    name : str
        Prefix of the holds' names: the file name without extensions.
    time_s : ndarray, shape (n_times,)
        Strictly increasing, seconds.
    columns : mapping of str to ndarray, shape (n_times,)
        Readings by column; NaN where missing.
    units : mapping of str to str or None
        ``ohm``, ``percent``, ``counts``, ``volt``, ``newton``, ``pascal``, or None if unknown. SI
        prefixes are converted: readings in ``kOhm`` are stored in ohm.
    divider : Divider or None
        Circuit for the conversion of counts to ohms.
    is_hold : bool
        Whether the recording is already one hold (the table has a column ``hold_id``).
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
    """Read one recording from a file, a mapping of arrays or a pandas DataFrame.

    Parameters
    ----------
    source : path, mapping of str to array_like, or DataFrame
        CSV, TSV and other text tables, gzipped or not, .xlsx, or Parquet.
    time_column : str, optional
        The clock; by default recognised by name (``time``, ``t``, ``timestamp``, ``ms``, ...).
    time_unit : {"s", "ms", "us", "ns", "unix"}, optional
        Unit of a numeric clock; by default inferred from the column's name or its values.
    value_columns : sequence of str, optional
        The sensors; by default recognised by name (``resistance``, ``A0``, ``value``, ...).
    unit : {"ohm", "percent", "counts", "volt", "newton", "pascal"}, optional
        Unit of all value columns; by default inferred from their names.
    divider : Divider, optional
        Circuit with which counts were read; `cut_holds` then returns ohm.

    Raises
    ------
    InputError
        If the file, a table or a column isn't found, or time decreases.
    MissingExtraError
        If the file format needs an extra that isn't installed.

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
            f"{parts[0].name}: the table contains {len(parts)} recordings; `cut_holds` accepts "
            "such a table"
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
    """Read all recordings of a table; a column such as ``recording_id`` separates them."""
    table, stem = _load_table(source)
    if time_unit not in (None, *get_args(TimeUnit)) or unit not in (None, *get_args(Unit)):
        raise InputError(
            f"{table.name}: time_unit {time_unit} or unit {unit} is unknown; time_unit is one of "
            f"{', '.join(get_args(TimeUnit))}, unit one of {', '.join(get_args(Unit))}"
        )
    clock = _find_clock_column(table, time_column)
    values = _find_value_columns(table, clock, value_columns)
    found: list[Readings] = []
    for label, rows in _split_recordings(table):
        remarks = list(table.omissions) if not found else []
        where = f"{table.name} {label}".strip()
        raw_s, source_unit = convert_to_seconds(
            table.columns[clock][rows], name=clock, unit=time_unit, file=where
        )
        if source_unit != "s" and time_unit is None and time_unit_of(clock) == "":
            remarks.append(
                f"times in {clock} are interpreted as {source_unit}; --time-unit overrides this"
            )
        time_s, order = _order_times(raw_s, rows, table, clock, where=where, remarks=remarks)
        columns = {name: _average_repeats(table.columns[name][rows], order) for name in values}
        units: dict[str, Unit | None] = {name: unit or unit_of(name) for name in values}
        for name in values:
            if unit is None and scale_of(name) != 1.0:
                columns[name] = scale_of(name) * columns[name]
                remarks.append(f"{name} was converted to {units[name]}; --unit overrides this")
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


def _load_table(source: Any) -> tuple[Table, str]:
    """Return the table of a source, and its name without extensions."""
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        stem = path.name
        while Path(stem).suffix.lower() in _ENDINGS:
            stem = Path(stem).stem
        return read_table_file(path), stem
    if not isinstance(source, Mapping) and not hasattr(source, "columns"):
        raise InputError(
            f"a recording can't be a {type(source).__name__}; pass a file, a mapping of arrays or "
            "a DataFrame"
        )
    return table_of_arrays(source, name="recording"), "recording"


def _find_clock_column(table: Table, wanted: str | None) -> str:
    available = ", ".join(table.columns)[:120]
    if wanted is not None:
        if wanted not in table.columns:
            raise InputError(f"{table.name}: no column {wanted} (available: {available})")
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
    # Without a header, a first column that never decreases is the clock.
    if first == "1" and numbers.dtype == np.float64 and not (np.diff(numbers) < 0).any():
        return first
    raise InputError(
        f"{table.name}: no time column recognised; specify it with --time-column "
        f"(available: {available})"
    )


def _find_value_columns(table: Table, clock: str, wanted: Sequence[str]) -> list[str]:
    available = ", ".join(name for name in table.columns if name != clock)[:120]
    for name in wanted:
        if name not in table.columns:
            raise InputError(f"{table.name}: no column {name} (available: {available})")
        if name not in table.numeric():
            raise InputError(f"{table.name}: column {name} contains no numbers; choose another")
    numeric = [
        name for name in table.numeric() if name not in (clock, find_recording_column([name]))
    ]
    found = list(dict.fromkeys(wanted)) or find_readings(numeric)
    if not found:
        raise InputError(
            f"{table.name}: no column of readings besides {clock} (available: {available})"
        )
    return found


def _split_recordings(table: Table) -> list[tuple[str, slice]]:
    """Return the label and rows of each recording in a table."""
    part = find_recording_column(list(table.columns))
    if part is None:
        return [("", slice(0, table.rows))]
    labels = np.array([_format_label(cell) for cell in table.columns[part].tolist()], dtype=object)
    runs = find_runs(labels)
    return [(labels[rows.start] if len(runs) > 1 else "", rows) for rows in runs]


def _format_label(cell: object) -> str:
    """Return a label as text; a numeric column stores 1 as 1.0."""
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
    """Return the distinct times, and each row's time index (-1: no time)."""
    known = np.flatnonzero(np.isfinite(raw_s))
    bad = np.flatnonzero(~np.isfinite(raw_s))
    remarks += report_bad_rows(
        [(table.place(rows.start + int(row)), f"no time in column {clock}") for row in bad],
        total=raw_s.size,
        name=where,
    )
    time_s = raw_s[known]
    back = np.flatnonzero(np.diff(time_s) < 0)
    if back.size:
        row = rows.start + int(known[back[0] + 1])
        raise InputError(
            f"{where} {table.place(row)}: time decreases ({time_s[back[0]]:g} s, then "
            f"{time_s[back[0] + 1]:g} s); sort the rows, or save each recording as its own file"
        )
    is_new = np.diff(time_s, prepend=-np.inf) > 0
    if not is_new.all():
        remarks.append(
            f"{int((~is_new).sum())} rows repeat the previous time; their readings were averaged"
        )
    order = np.full(raw_s.size, -1, dtype=np.intp)
    order[known] = np.cumsum(is_new) - 1
    return time_s[is_new], order


def _average_repeats(column: NDArray[np.float64], order: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the mean of the readings at each time; NaN without a reading."""
    use = (order >= 0) & np.isfinite(column)
    size = int(order.max(initial=-1)) + 1
    counts = np.bincount(order[use], minlength=size)
    sums = np.bincount(order[use], weights=column[use], minlength=size)
    means = np.full(size, np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return means


def relative_readings(readings: Readings, *, rest_s: tuple[float, float], mean: bool) -> Readings:
    """Return a recording as relative changes in percent, by column or as their mean.

    Parameters
    ----------
    readings : Readings
        In ohm, or in counts with a divider. A column without a unit is in counts if there is one.
    rest_s : tuple of float
        Start and end of a stretch without load, seconds of the recording.
    mean : bool
        Whether to average over all columns (section 2.1), ignoring missing and open readings.

    Raises
    ------
    InputError
        If a column is in another unit, or has too few readings at rest.

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
        ohm = _column_ohm(readings, name)
        rest = ohm[at_rest & np.isfinite(ohm) & (ohm > 0)]
        if rest.size < _MIN_REST_READINGS:
            raise InputError(
                f"{readings.name}: {name}: {rest.size} readings at rest from {begin_s:g} to "
                f"{end_s:g} s, but {_MIN_REST_READINGS} are needed; change --rest, or exclude the "
                "column with --value-column"
            )
        change = 100.0 * (ohm / np.mean(rest) - 1.0)
        changes[name] = np.where(np.isfinite(change), change, np.nan)
    columns: Mapping[str, NDArray[np.float64]] = changes
    if mean:
        together = np.stack(list(changes.values()), axis=-1)
        columns = {MEAN_COLUMN: np.asarray(mean_change(together[:, None, :]))}
    return replace(readings, columns=columns, units=dict.fromkeys(columns, "percent"), divider=None)


def _column_ohm(readings: Readings, name: str) -> NDArray[np.float64]:
    unit, values = readings.units[name], readings.columns[name]
    if unit in (None, "counts") and readings.divider is not None:
        return np.asarray(resistance_ohm(values, divider=readings.divider))
    if unit not in (None, "ohm"):
        remedy = "; add --adc-bits, --reference-ohm and --sensor-leg" if unit == "counts" else ""
        raise InputError(
            f"{readings.name}: {name}: --rest converts ohms to relative changes, but the unit is "
            f"{unit}" + remedy
        )
    return values
