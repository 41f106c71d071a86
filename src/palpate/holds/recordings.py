"""Recordings from any logger: a clock in seconds and sensor readings."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.chosen_columns import (
    COUNTED,
    check_fractions,
    check_units,
    find_clock_column,
    find_value_columns,
    increases,
    name_unused,
    split_recordings,
)
from palpate.holds.columns import (
    TimeUnit,
    convert_to_seconds,
    find_clocks,
    find_recording_column,
    is_function,
    names_sensor,
    scale_of,
    time_unit_of,
    unit_of,
)
from palpate.holds.decimals import MARKS
from palpate.holds.frames import (
    Frames,
    check_blocks,
    find_sensor_column,
    join_clock_change,
    merge_repeats,
    split_by_label,
    split_frames,
    split_restarts,
)
from palpate.holds.split_clock import join_split_clock
from palpate.holds.table import Table, report_bad_rows
from palpate.holds.table_files import read_table_file, table_of_arrays
from palpate.holds.units import Unit
from palpate.signal.circuit import Divider

#: Extensions of tables, removed repeatedly, so the stem of ``log.csv.gz`` is ``log``.
TABLE_ENDINGS = (
    *(".csv", ".tsv", ".txt", ".dat", ".log", ".gz", ".lvm", ".jsonl", ".ndjson"),
    *(".xlsx", ".xlsm", ".parquet", ".pq"),
)


#: A first row that is this many usual intervals before the others is not of the recording.
_LONE_STEPS = 300.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingTable:
    """A recording: readings of one or more sensors on one clock.

    Attributes
    ----------
    name : str
        Prefix of the holds' names: the file name without extensions.
    time_s : ndarray, shape (n_times,)
        Strictly increasing, seconds.
    columns : mapping of str to ndarray, shape (n_times,)
        Readings by column; NaN where missing, infinity where a meter was above its range.
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
    interval_s: float | None = None,
    sheet: str | None = None,
    decimal: Literal["point", "comma"] | None = None,
) -> ReadingTable:
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
    interval_s : float, optional
        Time between rows of a table without a clock, seconds.
    sheet : str, optional
        Sheet of a workbook; by default the first with times and readings.
    decimal : {"point", "comma"}, optional
        Decimal mark of a text file; by default found in its numbers.

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
        interval_s=interval_s,
        sheet=sheet,
        decimal=decimal,
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
    interval_s: float | None = None,
    sheet: str | None = None,
    decimal: Literal["point", "comma"] | None = None,
) -> list[ReadingTable]:
    """Read all recordings of a table.

    A column such as ``recording_id`` separates them, or a clock that restarts.
    `source`: as in `read_recording`, or a `Table` that was read before.
    """
    table, stem = _load_table(
        source, sheet=sheet, decimal=decimal, without_clock=interval_s is not None
    )
    if time_unit not in (None, *get_args(TimeUnit)) or unit not in (None, *get_args(Unit)):
        raise InputError(
            f"{table.name}: time_unit {time_unit} or unit {unit} is unknown; time_unit is one of "
            f"{', '.join(get_args(TimeUnit))}, unit one of {', '.join(get_args(Unit))}"
        )
    remarks = list(table.omissions)
    if interval_s is not None:
        if time_column is not None:
            raise InputError(
                f"{table.name}: an interval replaces the time column; omit one of both"
            )
        clock, time_unit = COUNTED, "s"
        own = [name for name in find_clocks([*table.columns]) if increases(table, name)]
        if own:
            remarks.append(f"--interval replaces the times in {', '.join(own)}")
        counted = interval_s * np.arange(table.rows, dtype=np.float64)
        table = replace(table, columns={**table.columns, clock: counted})
    else:
        if time_column is None:
            table, joined = join_split_clock(table)
            remarks += joined
        clock = find_clock_column(table, time_column, remarks=remarks)
    values = find_value_columns(table, clock, value_columns, remarks=remarks)
    if unit is None:
        check_units(values, file=table.name)
        check_fractions(table, values)
        remarks += [
            f"{name} is a function of a reading and is predicted as it is, without a unit; --unit "
            "overrides this"
            for name in values
            if is_function(name)
        ]
    if not value_columns:
        remarks += name_unused(table, values, clock)
    found: list[ReadingTable] = []
    for label, rows in split_recordings(table):
        where = f"{table.name} {label}".strip()
        parts = _read_rows(
            table, rows, clock=clock, time_unit=time_unit, values=values, where=where, notes=remarks
        )
        for part, frames in parts:
            own = list(frames.remarks)
            time_s, readings = merge_repeats(frames, remarks=own)
            units = _convert_units(readings, values, unit=unit, remarks=own)
            found.append(
                ReadingTable(
                    name=":".join(filter(None, (stem, label, part))),
                    is_hold="hold_id" in table.columns,
                    time_s=time_s,
                    columns=readings,
                    units=units,
                    divider=divider,
                    remarks=[*remarks, *own],
                )
            )
            remarks = []
    return found


def _read_rows(
    table: Table,
    rows: slice,
    *,
    clock: str,
    time_unit: TimeUnit | None,
    values: Sequence[str],
    where: str,
    notes: list[str],
) -> list[tuple[str, Frames]]:
    """Return the name and the frames of each part of a recording, between restarts of its clock.

    `notes`: receives the remarks.
    """
    raw_s, source_unit = convert_to_seconds(
        table.columns[clock][rows], name=clock, unit=time_unit, file=where
    )
    if source_unit != "s" and time_unit is None and time_unit_of(clock) == "":
        notes.append(
            f"times in {clock} are interpreted as {source_unit}; --time-unit overrides this"
        )
    known = np.flatnonzero(np.isfinite(raw_s))
    bad = np.flatnonzero(~np.isfinite(raw_s))
    notes += report_bad_rows(
        [(table.place(rows.start + int(row)), f"no time in column {clock}") for row in bad],
        total=raw_s.size,
        name=where,
    )
    steps_s = np.diff(raw_s[known])
    if steps_s.size > 2 and steps_s[0] > _LONE_STEPS * np.median(np.abs(steps_s)):
        # A log that begins within a line has lost digits of the first time.
        notes.append(f"{table.place(rows.start + int(known[0]))} was omitted: its time is far off")
        known = known[1:]
    time_s = raw_s[known]
    columns = {name: table.columns[name][rows][known] for name in values}
    texts = {
        name: column[rows][known]
        for name, column in table.columns.items()
        if name not in (clock, find_recording_column([name]))
        and (column.dtype == object or names_sensor(name) or name.isdigit())
    }
    # A column that is not read names the sensors rather than one of several readings.
    sensor = find_sensor_column(time_s, {n: c for n, c in texts.items() if n not in columns})
    if sensor is None and len(columns) > 1:
        sensor = find_sensor_column(time_s, {n: c for n, c in texts.items() if n in columns})
    if sensor is not None:
        columns.pop(sensor, None)
        return [("", split_by_label(time_s, columns, texts[sensor], column=sensor, where=where))]
    places = [table.place(rows.start + int(row)) for row in known]
    is_date = table.columns[clock].dtype != np.float64
    if is_date:
        time_s = join_clock_change(time_s, places, remarks=notes)
    stretches = split_restarts(time_s, places, is_date=is_date, where=where, remarks=notes)
    parts = [
        (
            part,
            split_frames(time_s[inside], {n: c[inside] for n, c in columns.items()}, where=where),
        )
        for part, inside in stretches
    ]
    if len(parts) == 1 and not parts[0][1].remarks and (np.diff(time_s) > 0).all():
        check_blocks(table)
    return parts


def _convert_units(
    readings: dict[str, NDArray[np.float64]],
    values: Sequence[str],
    *,
    unit: Unit | None,
    remarks: list[str],
) -> dict[str, Unit | None]:
    """Convert readings with a prefix of a unit in place; return the unit of each."""
    units = {name: unit or unit_of(_source_name(name, values)) for name in readings}
    for name in readings if unit is None else ():
        scale = scale_of(_source_name(name, values))
        if scale != 1.0:
            readings[name] = scale * readings[name]
            remarks.append(f"{name} was converted to {units[name]}; --unit overrides this")
    return units


def _source_name(name: str, values: Sequence[str]) -> str:
    """Return the table's column of a sensor, whose name has the sensor appended."""
    return next((one for one in values if name == one or name.startswith(f"{one} ")), values[0])


def _load_table(
    source: Any, *, sheet: str | None, decimal: str | None, without_clock: bool
) -> tuple[Table, str]:
    """Return the table of a source, and its name without extensions."""
    if isinstance(source, Table):
        return source, stem_of(source.name)
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        stem = stem_of(path.name)
        mark = None if decimal is None else MARKS[decimal]
        read = read_table_file(path, sheet=sheet, decimal=mark, without_clock=without_clock)
        return read, stem
    if not isinstance(source, Mapping) and not hasattr(source, "columns"):
        raise InputError(
            f"a recording can't be a {type(source).__name__}; pass a file, a mapping of arrays or "
            "a DataFrame"
        )
    return table_of_arrays(source, name="recording"), "recording"


def stem_of(name: str) -> str:
    """Return the name of a file without its folder and extensions.

    >>> stem_of("bench/log.csv.gz")
    'log'
    """
    stem = Path(name).name
    while Path(stem).suffix.lower() in TABLE_ENDINGS:
        stem = Path(stem).stem
    return stem


def find_clock(table: Table) -> str | None:
    """Return the name of the column that is taken as the clock; None if there is none."""
    try:
        return find_clock_column(table, None, remarks=[])
    except InputError:
        return None
