"""A clock in several columns: whole seconds and their fraction, or hours, minutes and seconds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.columns import convert_to_seconds, find_clocks, split_words
from palpate.holds.table import Table
from palpate.holds.units import PER_SECOND, TIME_UNITS

#: Seconds since 1970 of a date of 1973.
_EARLIEST_UNIX_S = 1e8
#: Counts in a second of the units of fractions.
_COUNTS = {"ms": 1e3, "us": 1e6, "ns": 1e9}


def join_split_clock(table: Table) -> tuple[Table, list[str]]:
    """Return a table with one clock for several, and a remark; otherwise the table itself.

    Minutes and seconds have columns of their own, and the seconds restart with each minute. Or the
    first never decreases and has whole seconds that repeat. The second restarts with each of
    them.
    """
    parts = {
        name: TIME_UNITS[name.lower()] for name in table.numeric() if name.lower() in TIME_UNITS
    }
    if {"min", "s"} <= {*parts.values()}:
        seconds = next(name for name, unit in parts.items() if unit == "s")
        each_s = [table.columns[name] / PER_SECOND[unit] for name, unit in parts.items()]
        time_s = np.sum(each_s, axis=0)
        if (np.diff(table.columns[seconds]) < 0).any() and (np.diff(time_s) >= 0).all():
            columns = {key: one for key, one in table.columns.items() if key not in parts}
            return replace(table, columns={"time_s": time_s, **columns}), [
                f"the times are {', '.join(parts)}"
            ]
    for clock, whole_s in _find_seconds(table):
        for name, counts in _find_fractions(table):
            fraction = table.columns[name] / counts
            known = np.isfinite(fraction) & np.isfinite(whole_s)
            within = fraction[known]
            time_s = whole_s + fraction
            if (
                known.any()
                and (within >= 0.0).all()
                and (within < 1.0).all()
                and (np.diff(within) < 0.0).any()
                and (np.diff(time_s[known]) >= 0.0).all()
            ):
                columns = {key: values for key, values in table.columns.items() if key != name}
                columns[clock] = time_s
                return replace(table, columns=columns), [f"the times are {clock} and {name}"]
    return table, []


def _find_seconds(table: Table) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the clocks in whole seconds of which some repeat, and their seconds."""
    first = next(iter(table.columns), "")
    numbers = table.columns[first] if first.isdigit() else np.empty(0, object)
    is_unix = numbers.dtype == np.float64 and (numbers >= _EARLIEST_UNIX_S).all()
    for name in [first] if is_unix else find_clocks([*table.columns]):
        try:
            time_s, _ = convert_to_seconds(
                table.columns[name], name=name, unit="s", file=table.name
            )
        except InputError:
            continue
        steps = np.diff(time_s[np.isfinite(time_s)])
        if (steps == 0.0).any() and (steps >= 0.0).all() and (steps == np.rint(steps)).all():
            yield name, time_s


def _find_fractions(table: Table) -> Iterator[tuple[str, float]]:
    """Yield the columns of fractions of a second, and their counts in a second."""
    for name in table.numeric():
        if name.isdigit():
            # The second column without a name: nanoseconds or microseconds up to their second.
            top = np.nanmax(table.columns[name])
            yield from ((name, counts) for counts in (1e6, 1e9) if 0.5 * counts <= top < counts)
        units = [TIME_UNITS.get(word, "") for word in split_words(name)]
        unit = next((unit for unit in units if unit in _COUNTS), None)
        if unit is not None:
            yield name, _COUNTS[unit]
