"""What a column is, by its name: a clock, a sensor's reading and its unit, or something else."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Literal, TypeAlias

TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns", "unix"]
Unit: TypeAlias = Literal["ohm", "percent", "counts", "volt"]

_SECONDS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millis", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "micros", "microsecond", "microseconds"),
    "ns": ("ns", "nanoseconds"),
    "unix": ("unix", "epoch"),
}
_TIME_UNITS = {word: unit for unit, words in _SECONDS.items() for word in words}
_CLOCKS = {"time", "t", "timestamp", "datetime", "date", "elapsed", "clock", "zeit", "zeitstempel"}
_UNITS: dict[Unit, set[str]] = {
    "ohm": {"ohm", "ohms", "ω", "kohm", "kω", "resistance", "r", "widerstand"},
    "percent": {"percent", "%", "relative", "rel"},
    "counts": {"counts", "adc", "raw", "analog"},
    "volt": {"v", "mv", "volt", "volts", "voltage"},
}
_READINGS = {"value", "values", "reading", "readings", "sensor", "signal", "fsr", "velostat"}
_READINGS |= {"pixel", "taxel", "pressure", "conductance", "ch", "channel", "s", "p", "wert"}
#: What often stands beside a sensor's reading and isn't one.
_OTHERS = {"force", "load", "weight", "newton", "n", "temperature", "temp", "humidity", "index"}
_OTHERS |= {"displacement", "position", "distance", "width", "sample", "sequence", "id", "row"}
_OTHERS |= {"phase", "touch", "trial", "label", "moving", "oversampling", "current", "ma", "mm"}
_OTHERS |= {"kpa", "date", "count", "number", "no", "unnamed", "event", "events", "location"}
_PART = ("recording_id", "recording", "run_id", "run", "trial_id", "session", "hold_id")


def words_of(name: str) -> list[str]:
    """Return the words of a column's name, in small letters, numbers apart.

    Examples
    --------
    >>> words_of("timeMs"), words_of("Resistance [kΩ]"), words_of("A0"), words_of("r0c1_ohm")
    (['time', 'ms'], ['resistance', 'kω'], ['a', '0'], ['r', '0', 'c', '1', 'ohm'])
    """
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return re.findall(r"\d+|%|[^\W\d_]+", apart.lower())


def time_unit_of(name: str) -> str | None:
    """Return the unit of a clock's name, "" for a clock without one, None for no clock.

    Examples
    --------
    >>> [time_unit_of(name) for name in ("time_s", "millis", "Time [ms]", "timestamp", "force_n")]
    ['s', 'ms', 'ms', '', None]
    """
    words = words_of(name)
    if not words:
        return None
    clock = any(word in _CLOCKS for word in words)
    unit = next((_TIME_UNITS[word] for word in reversed(words) if word in _TIME_UNITS), None)
    if unit is not None and (clock or len(words) == 1):
        return unit
    return "" if clock and len(words) <= 2 else None


def find_clock(names: Sequence[str]) -> str | None:
    """Return the column that is the clock; one that names its unit before one that doesn't."""
    units = {name: time_unit_of(name) for name in names}
    clocks = [name for name, unit in units.items() if unit is not None]
    return min(clocks, key=lambda name: (units[name] == "", "date" in words_of(name)), default=None)


def unit_of(name: str) -> Unit | None:
    """Return the unit that a reading's name tells, if any.

    Examples
    --------
    >>> [unit_of(name) for name in ("R1", "resistance_ohm", "A0", "ch1_V", "value")]
    ['ohm', 'ohm', 'counts', 'volt', None]
    """
    words = words_of(name)
    if len(words) == 2 and words[0] == "a" and words[1].isdigit():
        return "counts"
    found = [unit for word in reversed(words) for unit in _UNITS if word in _UNITS[unit]]
    # The last word tells best: r0c0_counts is in counts.
    exact = [unit for unit in found if words[-1] in _UNITS[unit]]
    return next(iter(exact or found), None)


def find_readings(names: Sequence[str]) -> list[str]:
    """Return the columns that are readings of a sensor.

    Those that are called so; where none is, all that aren't called something else. Counts are left
    out where the same column is there in ohm.

    Examples
    --------
    >>> find_readings(["resistance_ohm", "force_n"]), find_readings(["left", "right", "temp_c"])
    (['resistance_ohm'], ['left', 'right'])
    >>> find_readings(["r0c0_counts", "r0c0_ohm"])
    ['r0c0_ohm']
    """
    other = [name for name in names if _OTHERS & set(words_of(name))]
    called = [n for n in names if n not in other and (unit_of(n) or _READINGS & set(words_of(n)))]
    found = called or [name for name in names if name not in other] or list(names)
    in_ohm = {name.removesuffix("_ohm") for name in found if name.endswith("_ohm")}
    return [n for n in found if not (n.endswith("_counts") and n.removesuffix("_counts") in in_ohm)]


def find_part(names: Sequence[str]) -> str | None:
    """Return the column that says which of several recordings a row belongs to."""
    return next((name for part in _PART for name in names if name.lower() == part), None)
