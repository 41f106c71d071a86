"""The columns of a table that are its clock and its readings, and the rows of each recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.columns import (
    bracketed_time_unit,
    convert_to_seconds,
    find_clocks,
    find_readings,
    find_recording_column,
    is_index,
    match_name,
    names_sensor,
    split_words,
    time_unit_of,
    unit_of,
)
from palpate.holds.decimals import is_number
from palpate.holds.moments import is_moment
from palpate.holds.table import Table, find_runs, label_text
from palpate.holds.units import find_unreadable_unit

#: Name of the clock made from an interval, and fewest rows from which a column may be a counter.
COUNTED = "row"
_FEWEST_COUNTED = 20
#: Ratio of two clocks that are taken for the same in other units, and its tolerance.
_UNIT_RATIOS, _RATIO_TOLERANCE = (1.0, 1e3, 1e6), 0.02
#: A counter restarts if it falls below this fraction of its last value.
_RESTART_FRACTION = 0.5


def find_clock_column(table: Table, wanted: str | None, *, remarks: list[str]) -> str:
    available = ", ".join(table.columns)[:120]
    if wanted is not None:
        found = match_name(table.columns, wanted)
        if found is None:
            raise InputError(f"{table.name}: no column {wanted} (available: {available})")
        return found
    moments = [
        name
        for name, column in table.columns.items()
        if column.dtype.kind in "mM" or (column.dtype == object and has_moments(column))
    ]
    named = [
        name
        for name in find_clocks(list(table.columns))
        if table.columns[name].dtype != object or name in moments
    ]
    if not named and not moments:
        named = [n for n in table.columns if bracketed_time_unit(n) and _counts(table, n)]
    clocks = list(dict.fromkeys([*named, *moments]))
    if not named:
        clocks += _find_counters(table, clocks)
    increasing = [name for name in clocks if increases(table, name)]
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
    if clocks and not _is_constant(table.columns[clocks[0]]):
        return clocks[0]
    if clocks:
        raise InputError(
            f"{table.name}: column {clocks[0]} has the same time in every row; give the time "
            "between rows with --interval, or another clock with --time-column"
        )
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


def _is_constant(column: NDArray[Any]) -> bool:
    return column.size > 1 and bool((column == column[0]).all())


def has_moments(column: NDArray[Any]) -> bool:
    """Return whether most texts of a column are dates or times of day."""
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


def increases(table: Table, name: str) -> bool:
    """Return whether a clock never decreases within a recording, and is not constant."""
    try:
        for _, rows in split_recordings(table):
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


def find_value_columns(
    table: Table, clock: str, wanted: Sequence[str], *, remarks: list[str]
) -> list[str]:
    available = ", ".join(name for name in table.columns if name not in (clock, COUNTED))[:120]
    chosen = list[str]()
    for one in wanted:
        name = match_name([n for n in table.columns if n not in (clock, COUNTED)], one)
        if name is None:
            raise InputError(f"{table.name}: no column {one} (available: {available})")
        if name not in table.numeric():
            raise InputError(f"{table.name}: column {name} contains no numbers; choose another")
        chosen.append(name)
    if chosen:
        return list(dict.fromkeys(chosen))
    numeric = [
        name
        for name in table.numeric()
        if name not in (clock, find_recording_column([name])) and time_unit_of(name) is None
    ]
    rows = [name for name in numeric if _counts(table, name) and _is_row_number(table, name)]
    if rows and (len(rows) < len(numeric) or len(table.columns) > len(rows) + 1):
        remarks.append(f"column {', '.join(rows)} counts the rows and is not read as a sensor")
        numeric = [name for name in numeric if name not in rows]
    counters = [n for n in numeric if n.isdigit() and _counts(table, n, restarts=True)]
    if counters and len(counters) < len(numeric):
        remarks.append(f"column {', '.join(counters)} always increases and is not read as a sensor")
        numeric = [name for name in numeric if name not in counters]
    found = find_readings(numeric)
    if not found:
        texts = [
            f"{name} has texts such as {str(text)[:30]!a}"
            for name, cells in table.columns.items()
            if cells.dtype == object and name != clock
            for text in [next((one for one in cells if not is_number(str(one))), "")]
        ]
        raise InputError(
            f"{table.name}: no column of readings besides {clock} (available: {available}"
            f"{''.join(f'; {text}' for text in texts[:2])}); choose one with --value-column, or "
            "write its cells as numbers"
        )
    return found


def _is_row_number(table: Table, name: str) -> bool:
    numbers = table.columns[name]
    return bool((numbers[1:] == numbers[:-1] + 1.0).all())


def check_units(values: Sequence[str], *, file: str) -> None:
    """Raise `InputError` if the unit of a column is a multiple, or not understood."""
    for name in values:
        unreadable = find_unreadable_unit(name)
        if unreadable is not None:
            raise InputError(
                f"{file}: column {name}: readings in {unreadable!a} can't be converted; write "
                "their unit in plain letters (kOhm), or convert them and say --unit"
            )


def check_fractions(table: Table, values: Sequence[str]) -> None:
    """Raise `InputError` if a relative change without % in its name may be a fraction."""
    for name in values:
        known = table.columns[name][np.isfinite(table.columns[name])]
        is_small = known.size > 0 and float(np.abs(known).max()) <= 1.0
        if is_small and unit_of(name) == "percent" and not {"%", "percent"} & {*split_words(name)}:
            raise InputError(
                f"{table.name}: column {name}: {known.min():.3g} to {known.max():.3g} may be "
                "percent or fractions; say --unit percent, or multiply fractions by 100"
            )


def name_unused(table: Table, values: Sequence[str], clock: str) -> list[str]:
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


def split_recordings(table: Table) -> list[tuple[str, slice]]:
    """Return the label and rows of each recording in a table."""
    part = find_recording_column(list(table.columns))
    if part is None:
        return [("", slice(0, table.rows))]
    labels = np.array([label_text(cell) for cell in table.columns[part].tolist()], dtype=object)
    runs = find_runs(labels)
    return [(labels[rows.start] if len(runs) > 1 else "", rows) for rows in runs]
