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
from palpate.holds.columns import (
    TimeUnit,
    convert_to_seconds,
    find_clocks,
    find_readings,
    find_recording_column,
    is_index,
    names_sensor,
    scale_of,
    time_unit_of,
    unit_of,
)
from palpate.holds.decimals import MARKS
from palpate.holds.frames import Frames, find_sensor_column, split_by_label, split_frames
from palpate.holds.moments import is_moment
from palpate.holds.split_clock import join_split_clock
from palpate.holds.table import Table, find_runs, report_bad_rows
from palpate.holds.table_files import read_table_file, table_of_arrays
from palpate.holds.units import Unit, find_multiple
from palpate.signal.circuit import Divider, resistance_ohm
from palpate.signal.relative import mean_change

#: Name of the column with the mean of the relative changes.
MEAN_COLUMN = "mean change"
#: Minimum readings at rest in each column.
_MIN_REST_READINGS = 3
#: Name of the clock made from an interval, and most rows from which a column may be a counter.
_COUNTED = "row"
_FEWEST_COUNTED = 20
#: Most lines of a frame that are recognised by the lines between frames.
_MOST_BLOCK_ROWS = 64
#: Ratio of two clocks that are taken for the same in other units, and its tolerance.
_UNIT_RATIOS, _RATIO_TOLERANCE = (1.0, 1e3, 1e6), 0.02
#: Rows of one time from which a clock is called coarse.
_SPREAD_ROWS = 3
#: A clock restarts if it falls below this fraction of its last value, or to its first value; and
#: this many rows may be between two restarts at least.
_RESTART_FRACTION, _FEWEST_PART_ROWS = 0.5, 3
#: Extensions, removed repeatedly, so the stem of ``log.csv.gz`` is ``log``.
_ENDINGS: tuple[str, ...] = (
    ".gz",
    ".csv",
    ".tsv",
    ".txt",
    ".dat",
    ".log",
    ".xlsx",
    ".xlsm",
    ".parquet",
    ".pq",
)
_ENDINGS += (".lvm", ".jsonl", ".ndjson")


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
        clock, time_unit = _COUNTED, "s"
        own = [name for name in find_clocks([*table.columns]) if _increases(table, name)]
        if own:
            remarks.append(f"--interval replaces the times in {', '.join(own)}")
        counted = interval_s * np.arange(table.rows, dtype=np.float64)
        table = replace(table, columns={**table.columns, clock: counted})
    else:
        if time_column is None:
            table, joined = join_split_clock(table)
            remarks += joined
        clock = _find_clock_column(table, time_column, remarks=remarks)
    values = _find_value_columns(table, clock, value_columns, remarks=remarks)
    if unit is None:
        _check_units(values, file=table.name)
    if not value_columns:
        remarks += _name_unused(table, values, clock)
    found: list[ReadingTable] = []
    for label, rows in _split_recordings(table):
        where = f"{table.name} {label}".strip()
        raw_s, source_unit = convert_to_seconds(
            table.columns[clock][rows], name=clock, unit=time_unit, file=where
        )
        if source_unit != "s" and time_unit is None and time_unit_of(clock) == "":
            remarks.append(
                f"times in {clock} are interpreted as {source_unit}; --time-unit overrides this"
            )
        known = np.flatnonzero(np.isfinite(raw_s))
        bad = np.flatnonzero(~np.isfinite(raw_s))
        remarks += report_bad_rows(
            [(table.place(rows.start + int(row)), f"no time in column {clock}") for row in bad],
            total=raw_s.size,
            name=where,
        )
        time_s = raw_s[known]
        columns = {name: table.columns[name][rows][known] for name in values}
        texts = {
            name: column[rows][known]
            for name, column in table.columns.items()
            if name not in (clock, find_recording_column([name]))
            and (column.dtype == object or names_sensor(name))
        }
        sensor = find_sensor_column(time_s, {n: c for n, c in texts.items() if n not in columns})
        if sensor is None:
            sensor = find_sensor_column(
                time_s, {n: c for n, c in texts.items() if len(columns) > 1 and n in columns}
            )
        parts = [("", Frames(time_s=time_s, columns=columns))]
        if sensor is not None:
            columns.pop(sensor, None)
            parts = [
                ("", split_by_label(time_s, columns, texts[sensor], column=sensor, where=where))
            ]
        else:
            places = [table.place(rows.start + int(row)) for row in known] if known.size else []
            is_date = table.columns[clock].dtype != np.float64
            stretches = _split_restarts(
                time_s, places, is_date=is_date, where=where, remarks=remarks
            )
            parts = [
                (part, split_frames(time_s[inside], _take(columns, inside), where=where))
                for part, inside in stretches
            ]
            if len(parts) == 1 and not parts[0][1].remarks and (np.diff(time_s) > 0).all():
                _check_blocks(table)
        for part, frames in parts:
            names = ":".join(filter(None, (stem, label, part)))
            own = list(frames.remarks)
            time_s, readings = _merge_repeats(frames, remarks=own)
            units = {name: unit or unit_of(_source_name(name, values)) for name in readings}
            for name in readings:
                scale = scale_of(_source_name(name, values))
                if unit is None and scale != 1.0:
                    readings[name] = scale * readings[name]
                    own.append(f"{name} was converted to {units[name]}; --unit overrides this")
            found.append(
                ReadingTable(
                    name=names,
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


def _source_name(name: str, values: Sequence[str]) -> str:
    """Return the table's column of a sensor, whose name has the sensor appended."""
    return next((one for one in values if name == one or name.startswith(f"{one} ")), values[0])


def _take(
    columns: Mapping[str, NDArray[np.float64]], rows: slice
) -> dict[str, NDArray[np.float64]]:
    return {name: values[rows] for name, values in columns.items()}


def _name_unused(table: Table, values: Sequence[str], clock: str) -> list[str]:
    """Return a remark about the columns of numbers that are not predicted."""
    others = [
        name
        for name in table.numeric()
        if name not in (*values, clock, find_recording_column([name]))
        and time_unit_of(name) is None
        and not (names_sensor(name) or is_index(name) or name.isdigit())
    ]
    if not others:
        return []
    return [f"not predicted: {', '.join(others)[:200]}; --value-column NAME predicts a column"]


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
    while Path(stem).suffix.lower() in _ENDINGS:
        stem = Path(stem).stem
    return stem


def find_clock(table: Table) -> str | None:
    """Return the name of the column that is taken as the clock; None if there is none."""
    try:
        return _find_clock_column(table, None, remarks=[])
    except InputError:
        return None


def _find_clock_column(table: Table, wanted: str | None, *, remarks: list[str]) -> str:
    available = ", ".join(table.columns)[:120]
    if wanted is not None:
        if wanted not in table.columns:
            raise InputError(f"{table.name}: no column {wanted} (available: {available})")
        return wanted
    moments = [
        name
        for name, column in table.columns.items()
        if column.dtype.kind in "mM" or (column.dtype == object and _is_moments(column))
    ]
    named = [
        name
        for name in find_clocks(list(table.columns))
        if table.columns[name].dtype != object or name in moments
    ]
    clocks = list(dict.fromkeys([*named, *moments]))
    if not named:
        clocks += _find_counters(table, clocks)
    increasing = [name for name in clocks if _increases(table, name)]
    _check_clock_pairs(table, increasing)
    if len(clocks) > 1 and increasing:
        if not named and len(increasing) > 1:
            # A board's own clock is finer than the terminal's.
            own = next((n for n in increasing[1:] if _is_same_clock(table, increasing[0], n)), None)
            if own is not None:
                remarks.append(f"column {own} is used as the clock; --time-column overrides this")
                return own
        if len(increasing) > 1:
            others = ", ".join(increasing[1:])
            remarks.append(
                f"{increasing[0]} is used as the clock, and not {others}; --time-column overrides "
                "this"
            )
        return increasing[0]
    if clocks:
        return clocks[0]
    raise InputError(
        f"{table.name}: no time column recognised; specify it with --time-column (available: "
        f"{available}), or the time between rows with --interval"
    )


def _check_clock_pairs(table: Table, clocks: Sequence[str]) -> None:
    """Raise `InputError` if each clock precedes readings of its own."""
    names = [*table.columns]
    places = sorted(names.index(name) for name in clocks)
    is_pair = all(place + 1 < len(names) and place + 1 not in places for place in places)
    if len(places) < 2 or places[0] != 0 or not is_pair:
        return
    each = [
        convert_to_seconds(table.columns[name], name=name, unit=None, file=table.name)[0]
        for name in (names[place] for place in places)
    ]
    step_s = float(np.nanmedian(np.abs(np.diff(each[0]))))
    if all(np.nanmax(np.abs(one - each[0])) <= step_s for one in each[1:]):
        return
    listed = ", ".join(names[place] for place in places)
    raise InputError(
        f"{table.name}: {listed} are clocks of different readings; choose one with --time-column, "
        "and its readings with --value-column"
    )


def _check_blocks(table: Table) -> None:
    """Raise `InputError` if empty lines separate frames of several lines."""
    numbers = np.asarray(table.numbers)
    if table.word != "line" or numbers.size < 2 * _FEWEST_COUNTED:
        return
    begins = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 2) > 1)
    sizes = np.diff(begins)
    size = int(np.median(sizes)) if sizes.size else 0
    if not 2 <= size <= _MOST_BLOCK_ROWS or sizes.size < _FEWEST_COUNTED // 2:
        return
    gaps = np.diff(numbers)[begins[1:] - 1]
    if (sizes == size).mean() > 0.9 and (gaps == np.median(gaps)).mean() > 0.9:
        raise InputError(
            f"{table.name}: other lines separate blocks of {size} lines of readings, like frames; "
            "write the readings of a frame in one line"
        )


def _check_units(values: Sequence[str], *, file: str) -> None:
    """Raise `InputError` if a column is in a multiple of a unit."""
    for name in values:
        multiple = find_multiple(name)
        if multiple is not None:
            raise InputError(
                f"{file}: column {name}: readings in {multiple!a} can't be converted; convert "
                "them, or give their unit with --unit"
            )


def _is_moments(column: NDArray[Any]) -> bool:
    filled = [str(text) for text in column[:50].tolist() if str(text).strip()]
    return bool(filled) and sum(map(is_moment, filled)) > 0.5 * len(filled)


def _find_counters(table: Table, clocks: Sequence[str]) -> list[str]:
    """Return the columns without a name that may be a clock.

    They are the first, which may not decrease, and others that always increase.
    """
    return [
        name
        for place, name in enumerate(table.columns)
        if name.isdigit()
        and table.columns[name].dtype == np.float64
        and ((place == 0 and _never_decreases(table.columns[name])) or _counts(table, name))
    ]


def _never_decreases(numbers: NDArray[np.float64]) -> bool:
    return not (numbers[1:] < numbers[:-1]).any() and bool(numbers[-1] > numbers[0])


def _counts(table: Table, name: str, *, restarts: bool = False) -> bool:
    """Return whether a column always increases, as a clock or counter does.

    `restarts`: whether it may seldom fall to a fraction of its last value.
    """
    numbers = table.columns[name]
    if numbers.dtype != np.float64 or numbers.size < _FEWEST_COUNTED:
        return False
    before, after = numbers[:-1], numbers[1:]
    falls = ~(after > before)
    if not (restarts and falls.mean() <= 1.0 / _FEWEST_COUNTED):
        return not falls.any()
    return bool((after[falls] <= _RESTART_FRACTION * before[falls]).all())


def _is_row_number(table: Table, name: str) -> bool:
    numbers = table.columns[name]
    return bool((numbers[1:] == numbers[:-1] + 1.0).all())


def _increases(table: Table, name: str) -> bool:
    """Return whether a clock never decreases within a recording, and is not constant."""
    try:
        for _, rows in _split_recordings(table):
            time_s, _ = convert_to_seconds(
                table.columns[name][rows], name=name, unit="s", file=table.name
            )
            known = time_s[np.isfinite(time_s)]
            if (np.diff(known) < 0).any() or (known.size > 1 and known[-1] <= known[0]):
                return False
    except InputError:
        return False
    return True


def _is_same_clock(table: Table, coarse: str, fine: str) -> bool:
    """Return whether a column of numbers runs like a clock."""
    numbers = table.columns[fine]
    if numbers.dtype != np.float64:
        return False
    time_s, _ = convert_to_seconds(table.columns[coarse], name=coarse, unit=None, file=table.name)
    known = np.flatnonzero(np.isfinite(time_s) & np.isfinite(numbers))
    if known.size < _FEWEST_COUNTED:
        return False
    first, last = known[0], known[-1]
    ratio = (numbers[last] - numbers[first]) / max(float(time_s[last] - time_s[first]), 1e-9)
    return any(abs(ratio / unit - 1.0) < _RATIO_TOLERANCE for unit in _UNIT_RATIOS)


def _find_value_columns(
    table: Table, clock: str, wanted: Sequence[str], *, remarks: list[str]
) -> list[str]:
    available = ", ".join(name for name in table.columns if name not in (clock, _COUNTED))[:120]
    for name in wanted:
        if name not in table.columns:
            raise InputError(f"{table.name}: no column {name} (available: {available})")
        if name not in table.numeric():
            raise InputError(f"{table.name}: column {name} contains no numbers; choose another")
    if wanted:
        return list(dict.fromkeys(wanted))
    numeric = [
        name
        for name in table.numeric()
        if name not in (clock, find_recording_column([name])) and time_unit_of(name) is None
    ]
    rows = [name for name in numeric if _counts(table, name) and _is_row_number(table, name)]
    if rows and len(rows) < len(numeric):
        remarks.append(f"column {', '.join(rows)} counts the rows and is not read as a sensor")
        numeric = [name for name in numeric if name not in rows]
    counters = [n for n in numeric if n.isdigit() and _counts(table, n, restarts=True)]
    if counters and len(counters) < len(numeric):
        remarks.append(f"column {', '.join(counters)} always increases and is not read as a sensor")
        numeric = [name for name in numeric if name not in counters]
    found = find_readings(numeric)
    if not found:
        raise InputError(
            f"{table.name}: no column of readings besides {clock} (available: {available}); choose "
            "one with --value-column"
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


def _split_restarts(
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


def _merge_repeats(
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


def relative_readings(
    readings: ReadingTable, *, rest_s: tuple[float, float], mean: bool
) -> ReadingTable:
    """Return a recording as relative changes in percent, by column or as their mean.

    Parameters
    ----------
    readings : ReadingTable
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
    >>> table = {"time_s": [0, 1, 2, 3], "a_ohm": [9, 9, 9, 4.5], "b_ohm": [20, 20, 20, 20.0]}
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


def _column_ohm(readings: ReadingTable, name: str) -> NDArray[np.float64]:
    unit, values = readings.units[name], readings.columns[name]
    if unit in (None, "counts") and readings.divider is not None:
        return np.asarray(resistance_ohm(values, divider=readings.divider))
    circuit = "--adc-bits, --reference-ohm and --sensor-leg"
    if unit is None:
        raise InputError(
            f"{readings.name}: {name}: the unit is unknown, and --rest needs ohms; say --unit ohm, "
            f"or for counts give {circuit}"
        )
    if unit != "ohm":
        remedy = f"; add {circuit}" if unit == "counts" else ""
        raise InputError(
            f"{readings.name}: {name}: --rest converts ohms to relative changes, but the unit is "
            f"{unit}" + remedy
        )
    return values
