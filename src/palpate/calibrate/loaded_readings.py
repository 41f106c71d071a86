"""Readings with known loads, from tables of any logger.

The loads are weights in order, a column of the readings, or the file of a load cell. A table
without a clock has a settled reading in each row.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibrate.attached_loads import add_cell, add_weights, read_cell
from palpate.calibrate.loaded_sensor import LoadedPart, LoadedSensor, TableOptions
from palpate.calibrate.settled_rows import explain_rows
from palpate.errors import InputError
from palpate.holds.columns import (
    convert_to_seconds,
    find_recording_column,
    is_function,
    scale_of,
    unit_of,
)
from palpate.holds.formats import is_mcap
from palpate.holds.loads import LoadColumn, find_load_column, read_weights
from palpate.holds.recordings import ReadingTable, find_clock, read_recordings
from palpate.holds.split_clock import join_split_clock
from palpate.holds.table import Table, find_runs
from palpate.holds.table_files import read_table_file, table_of_arrays
from palpate.holds.units import Unit
from palpate.recording import load_recording
from palpate.recording.exporting import solve_resistance_ohm

#: Resolution to which voltages are converted.
_VOLT_BITS = 16
#: Name of the column of newtons while a table is read.
_LOAD = "known load [N]"
#: Beginning of the remark of `read_recordings` about columns that it does not predict.
_UNUSED = "not predicted:"
#: Loads above and readings below these belong to no sensor of this kind.
_MOST_N, _FEWEST_OHM = 1000.0, 100.0
#: Fewest rows of a sensor in a table of several.
_FEWEST_SENSOR_ROWS = 3


def read_loaded(
    source: str | os.PathLike[str] | Mapping[str, Any] | Any,
    *,
    weights: Any = None,
    load_cell: Any = None,
    options: TableOptions | None = None,
    require_loads: bool = True,
) -> list[LoadedSensor]:
    """Read the readings of a sensor, or of the sensors of a table of settled readings.

    `source`: as in `palpate.read_recording`, or a recording of palpate (.mcap).
    `weights`: as in `palpate.holds.loads.read_weights`.
    `load_cell`: a table with a clock and a column of loads.
    `require_loads`: whether a table without a clock needs loads to be one of settled readings.
    Raises `InputError` if a table can't be used, loads are given twice, or the weights do not match
    the holds of the readings.

    >>> table = {"load_n": [0.0, 1.0, 2.0, 4.0], "R_ohm": [9e3, 3e3, 2e3, 1e3]}
    >>> (sensor,) = read_loaded(table)
    >>> sensor.is_settled, sensor.columns, sensor.parts[0].load_n.tolist()
    (True, ('R_ohm',), [0.0, 1.0, 2.0, 4.0])
    """
    options = options or TableOptions()
    table = _read_source(source, options)
    own = find_load_column(table, wanted=options.load_column, unit=options.load_unit)
    given = "weights" if weights is not None else "load cell" if load_cell is not None else ""
    if weights is not None and load_cell is not None:
        raise InputError("give the weights or the load cell, not both")
    if own is not None and given:
        raise InputError(
            f"{table.name}: column {own.name} has loads already; omit the {given}, or remove the "
            "column"
        )
    clock, apart = options.time_column or find_clock(table), list[str]()
    if own is not None and clock is not None and clock != options.time_column:
        column = table.columns[clock]
        time_s, _ = convert_to_seconds(column, name=clock, unit=options.time_unit, file=table.name)
        rows = explain_rows(time_s, own.load_n, is_calendar=column.dtype != np.float64)
        if rows is not None:
            are_settled, why = rows
            if are_settled:
                rest = {name: one for name, one in table.columns.items() if name != clock}
                apart.append(
                    f"{clock}: {why}: each row is a settled reading under a weight "
                    f"(of a log: --time-column {clock})"
                )
                table, clock = replace(table, columns=rest), None
            else:
                apart.append(
                    f"{clock}: {why}: the log of a load cell (of settled readings: remove "
                    "this column)"
                )
    is_settled = clock is None and options.interval_s is None
    pressures = [name for name in table.numeric() if unit_of(name) == "pascal"]
    if is_settled and require_loads and own is None and not given and pressures:
        raise InputError(
            f"{table.name}: {', '.join(pressures)[:120]}: a pressure is no load; multiply it by "
            "the loaded area and name the column load_n"
        )
    listed = None if weights is None else read_weights(weights, unit=options.load_unit)
    if is_settled and listed is not None and listed.load_n.size == table.rows:
        own, listed = LoadColumn(name="", load_n=listed.load_n, taken=listed.taken), None
    cell = None
    if load_cell is not None:
        other = _read_source(load_cell, TableOptions())
        cell = read_cell(other, unit=options.load_unit, to=table, to_clock=clock)
    taken = [each.taken for each in (own, listed, cell) if each is not None]
    if own is not None:
        columns = {name: one for name, one in table.columns.items() if name != own.name}
        table = replace(table, columns={**columns, _LOAD: own.load_n})
    if is_settled and (own is not None or not require_loads):
        # Rows of settled readings have no clock, and the reader needs one.
        options = replace(options, interval_s=1.0)
    if own is not None:
        _check_swapped(table, own)
    tables = _split_sensors(table) if is_settled else [table]
    sensors = [_read_sensor(one, options, is_settled=is_settled) for one in tables]
    if cell is not None:
        sensors = [add_cell(one, cell, where=table.name) for one in sensors]
    if listed is not None:
        sensors = [add_weights(one, listed, table=table, clock=clock) for one in sensors]
    return [replace(one, taken=[*taken, *apart, *one.taken]) for one in sensors]


def _check_swapped(table: Table, loads: LoadColumn) -> None:
    """Raise `InputError` if the loads would be ohms, and the ohms loads."""
    largest_n = float(np.nanmax(loads.load_n, initial=0.0))
    for name in table.numeric():
        if name not in (_LOAD, loads.name) and unit_of(name) == "ohm":
            ohm = scale_of(name) * table.columns[name]
            ohm = ohm[np.isfinite(ohm)]
            if largest_n > _MOST_N and ohm.size and ohm.max() < _FEWEST_OHM:
                raise InputError(
                    f"{table.name}: loads up to {largest_n:.3g} N and readings up to "
                    f"{ohm.max():.3g} ohm; the columns {loads.name} and {name} seem to be swapped"
                )


def _read_source(source: Any, options: TableOptions) -> Table:
    """Return the table of a source, with date and time of day in one column."""
    if isinstance(source, Table):
        return source
    if not isinstance(source, str | os.PathLike):
        if not isinstance(source, Mapping) and not hasattr(source, "columns"):
            raise InputError(
                f"readings can't be a {type(source).__name__}; pass a file, a mapping of arrays or "
                "a DataFrame"
            )
        return table_of_arrays(source, name="recording")
    path = Path(source)
    if is_mcap(path):
        recording = load_recording(path)
        ohm = solve_resistance_ohm(recording)
        pixels = np.ndindex(ohm.shape[1:])
        columns = {f"r{row}c{col}_ohm": ohm[:, row, col] for row, col in pixels}
        arrays = {"time_s": recording.time_s, **columns}
        return Table(name=str(path), columns=arrays, numbers=range(1, len(ohm) + 1))
    mark = {"point": ".", "comma": ",", None: None}[options.decimal]
    without_clock = options.interval_s is not None
    table = read_table_file(path, sheet=options.sheet, decimal=mark, without_clock=without_clock)
    return table if without_clock else join_split_clock(table)[0]


def _split_sensors(table: Table) -> list[Table]:
    """Return the rows of each sensor of a table of settled readings, by its column of names."""
    for name, cells in table.columns.items():
        if cells.dtype != object or find_recording_column([name]) is not None:
            continue
        runs = find_runs(cells)
        labels = [str(cells[rows.start]) for rows in runs]
        if 1 < len(runs) == len({*labels}) <= table.rows / _FEWEST_SENSOR_ROWS:
            return [
                replace(
                    table,
                    name=f"{table.name} {label}",
                    columns={key: column[rows] for key, column in table.columns.items()},
                    numbers=table.numbers[rows],
                )
                for label, rows in zip(labels, runs, strict=True)
            ]
    return [table]


def _read_sensor(table: Table, options: TableOptions, *, is_settled: bool) -> LoadedSensor:
    """Return the readings of a table, with the loads of its own column."""
    given: dict[str, Any] = {
        "time_column": options.time_column,
        "time_unit": options.time_unit,
        "interval_s": options.interval_s,
    }
    plain = replace(table, columns={n: c for n, c in table.columns.items() if n != _LOAD})
    found = read_recordings(
        plain,
        value_columns=options.value_columns,
        unit=options.unit,
        divider=options.divider,
        **given,
    )
    loads: Sequence[ReadingTable | None] = [None] * len(found)
    if _LOAD in table.columns:
        loads = read_recordings(table, value_columns=[_LOAD], **given)
    columns, unit = _check_columns(found, where=table.name)
    divider, adc_bits, scale = options.divider, options.adc_bits, 1.0
    if options.supply_v is not None:
        if unit not in (None, "volt"):
            raise InputError(f"{table.name}: --supply-v is for readings in volts, not {unit}")
        adc_bits = divider.adc_bits if divider is not None else adc_bits or _VOLT_BITS
        scale, unit = 2**adc_bits / options.supply_v, "counts"
    parts = []
    for one, load in zip(found, loads, strict=True):
        load_n = np.full(one.time_s.size, np.nan)
        if load is not None:
            load_n = _at_times(one.time_s, load)
        values = scale * np.column_stack([one.columns[name] for name in columns])
        if options.supply_v is not None:
            # Noise at the ends of the range.
            values = np.clip(values, 0.0, scale * options.supply_v - 1.0)
        parts.append(LoadedPart(name=one.name, time_s=one.time_s, values=values, load_n=load_n))
    remarks = [text for one in found for text in one.remarks if not text.startswith(_UNUSED)]
    return LoadedSensor(
        name=table.name,
        columns=columns,
        unit=unit,
        divider=divider if unit in (None, "counts") else None,
        adc_bits=adc_bits if unit in (None, "counts") else None,
        parts=tuple(parts),
        is_settled=is_settled,
        remarks=remarks,
    )


def _check_columns(
    found: Sequence[ReadingTable], *, where: str
) -> tuple[tuple[str, ...], Unit | None]:
    """Return the columns of all recordings and their unit."""
    columns = tuple(found[0].columns)
    if any(tuple(one.columns) != columns for one in found):
        raise InputError(f"{where}: its recordings have different columns; choose --value-column")
    units = {one.units[name] for one in found for name in columns}
    if len(units) > 1:
        raise InputError(
            f"{where}: {', '.join(columns)[:120]} are in different units; choose the readings with "
            "--value-column"
        )
    (unit,) = units
    functions = [name for name in columns if is_function(name)]
    if unit is None and functions:
        raise InputError(
            f"{where}: {', '.join(functions)[:120]}: a function of a reading gives no force; give "
            "the readings themselves, such as ohms or counts"
        )
    if unit in ("newton", "pascal"):
        raise InputError(
            f"{where}: {', '.join(columns)[:120]}: no column of readings besides loads; choose one "
            "with --value-column"
        )
    return columns, unit


def _at_times(time_s: FloatArray, load: ReadingTable) -> FloatArray:
    """Return the loads of a recording at other times of the same clock."""
    load_n = np.asarray(load.columns[_LOAD])
    if np.array_equal(time_s, load.time_s):
        return load_n
    known = np.isfinite(load_n)
    if not known.any():
        return np.full(time_s.size, np.nan)
    return np.interp(time_s, load.time_s[known], load_n[known], left=np.nan, right=np.nan)
