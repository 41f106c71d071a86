"""Recognition of a table's columns from their names, units and time formats."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import datetime, time
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError

TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns", "unix"]
Unit: TypeAlias = Literal["ohm", "percent", "counts", "volt", "newton", "pascal"]

_TIME_UNIT_NAMES = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millis", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "micros", "microsecond", "microseconds"),
    "ns": ("ns", "nanoseconds"),
    "unix": ("unix", "epoch"),
}
_TIME_UNITS = {word: unit for unit, words in _TIME_UNIT_NAMES.items() for word in words}
_CLOCKS = {"time", "t", "timestamp", "datetime", "date", "elapsed", "clock", "zeit", "zeitstempel"}
_UNITS: dict[Unit, set[str]] = {
    "ohm": {"ohm", "ohms", "ω", "resistance", "r", "widerstand"},
    "percent": {"percent", "%", "relative", "rel"},
    "counts": {"counts", "adc", "raw", "analog"},
    "volt": {"v", "volt", "volts", "voltage"},
    "newton": {"n", "newton", "newtons"},
    "pascal": {"pa", "pascal", "pascals"},
}
#: SI prefixes, and the units that accept a prefix in a name, in upper or lower case.
_PREFIXES = {"G": 1e9, "M": 1e6, "K": 1e3, "k": 1e3, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6}
_PREFIXED = re.compile(
    r"(?<![^\W\d_])([GMKkmuµμ])(?: )?(?i:(ohms?|Ω|\u2126)|(v|volts?)|(n|newtons?)|(pa|pascals?))"
    r"(?![^\W\d_])"
)
_PREFIXED_UNITS: tuple[Unit, ...] = ("ohm", "volt", "newton", "pascal")
_READINGS = {"value", "values", "reading", "readings", "sensor", "signal", "fsr", "velostat"}
_READINGS |= {"pixel", "taxel", "pressure", "conductance", "ch", "channel", "s", "p", "wert"}
#: Columns that often accompany sensor readings but are not sensor readings.
_OTHERS = {"force", "load", "weight", "newton", "n", "temperature", "temp", "humidity", "index"}
_OTHERS |= {"displacement", "position", "distance", "width", "sample", "sequence", "id", "row"}
_OTHERS |= {"phase", "touch", "trial", "label", "moving", "oversampling", "current", "ma", "mm"}
_OTHERS |= {"kpa", "date", "count", "number", "no", "unnamed", "event", "events", "location"}
_RUN_COLUMNS = ("recording_id", "recording", "run_id", "run", "trial_id", "session", "hold_id")

_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
#: Unix times of 1973 and later, in seconds; each finer unit is a thousand times larger.
_EARLIEST_UNIX_S = 1e8
#: A board's 32-bit clock wraps to 0 after 71 min in microseconds, 49 days in milliseconds.
_WRAP = 2.0**32
#: Longest interval between readings at which holds are recorded, seconds.
_MAX_INTERVAL_S = 4.0
_DAY_S = 86400.0


def split_words(name: str) -> list[str]:
    """Split a column's name into lower-case words and numbers.

    >>> split_words("timeMs"), split_words("Resistance [kΩ]"), split_words("r0c1_ohm")
    (['time', 'ms'], ['resistance', 'kω'], ['r', '0', 'c', '1', 'ohm'])
    """
    separated = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return re.findall(r"\d+|%|[^\W\d_]+", separated.lower())


def time_unit_of(name: str) -> str | None:
    """Return a clock column's unit: "" without a unit, None for other columns.

    >>> [time_unit_of(name) for name in ("time_s", "millis", "Time [ms]", "timestamp", "force_n")]
    ['s', 'ms', 'ms', '', None]
    """
    words = split_words(name)
    if not words:
        return None
    clock = any(word in _CLOCKS for word in words)
    unit = next((_TIME_UNITS[word] for word in reversed(words) if word in _TIME_UNITS), None)
    if unit is not None and (clock or len(words) == 1):
        return unit
    return "" if clock and len(words) <= 2 else None


def find_clock(names: Sequence[str]) -> str | None:
    """Return the name of the clock column; a column with a unit takes precedence."""
    units = {name: time_unit_of(name) for name in names}
    clocks = [name for name, unit in units.items() if unit is not None]
    return min(
        clocks, key=lambda name: (units[name] == "", "date" in split_words(name)), default=None
    )


def unit_of(name: str) -> Unit | None:
    """Return the unit in a reading's name, if any.

    >>> [unit_of(name) for name in ("R1", "resistance_ohm", "A0", "ch1_V", "value")]
    ['ohm', 'ohm', 'counts', 'volt', None]
    """
    prefixed = _split_prefix(name)
    if prefixed is not None:
        return prefixed[0]
    words = split_words(name)
    if len(words) == 2 and words[0] == "a" and words[1].isdigit():
        return "counts"
    found = [unit for word in reversed(words) for unit in _UNITS if word in _UNITS[unit]]
    # The last word takes precedence, so r0c0_counts is in counts.
    exact = [unit for unit in found if words[-1] in _UNITS[unit]]
    return next(iter(exact or found), None)


def scale_of(name: str) -> float:
    """Return the factor of a name's SI prefix: 1000 for kilo-ohms; default 1.

    >>> [scale_of(name) for name in ("S1 [kOhm]", "R (MΩ)", "ch1_mV", "p_kPa", "resistance_ohm")]
    [1000.0, 1000000.0, 0.001, 1000.0, 1.0]
    """
    prefixed = _split_prefix(name)
    return 1.0 if prefixed is None else prefixed[1]


def _split_prefix(name: str) -> tuple[Unit, float] | None:
    """Return unit and factor of the last SI-prefixed unit in a name, if any."""
    found = list(_PREFIXED.finditer(re.sub(r"([a-z])([A-Z])", r"\1 \2", name)))
    if not found:
        return None
    groups = found[-1].groups()
    index = next(number for number, word in enumerate(groups[1:]) if word)
    return _PREFIXED_UNITS[index], _PREFIXES[groups[0]]


def find_readings(names: Sequence[str]) -> list[str]:
    """Return the names of the columns with sensor readings.

    Columns with common names for readings take precedence; if there are none, every column without
    another known meaning is used. Counts are omitted if the same pixel has a column in ohm.

    >>> find_readings(["resistance_ohm", "force_n"]), find_readings(["left", "right", "temp_c"])
    (['resistance_ohm'], ['left', 'right'])
    >>> find_readings(["r0c0_counts", "r0c0_ohm"])
    ['r0c0_ohm']
    """
    other = [name for name in names if _OTHERS & set(split_words(name))]
    named = [n for n in names if n not in other and (unit_of(n) or _READINGS & set(split_words(n)))]
    found = named or [name for name in names if name not in other] or list(names)
    in_ohm = {name.removesuffix("_ohm") for name in found if name.endswith("_ohm")}
    return [n for n in found if not (n.endswith("_counts") and n.removesuffix("_counts") in in_ohm)]


def find_recording_column(names: Sequence[str]) -> str | None:
    """Return the name of the column that identifies the recording of each row, if any."""
    return next((name for known in _RUN_COLUMNS for name in names if name.lower() == known), None)


def convert_to_seconds(
    column: NDArray[Any], *, name: str, unit: str | None, file: str
) -> tuple[NDArray[np.float64], str]:
    """Convert a clock column to seconds (NaN if missing); return seconds and source unit.

    Absolute times (Unix, dates, times of day) are shifted so that the first reading is at 0.

    `column`, shape (n_rows,): float64, datetime64, timedelta64, or text with ISO dates or times of
        day.
    `name`: the column's name, which may contain the unit.
    `unit`: unit of a numeric column; None to infer it.
    Raises `InputError` if the unit can't be determined, or a text is not a time.

    >>> column = np.array([0.0, 20.0, 40.0])
    >>> time_s, unit = convert_to_seconds(column, name="t", unit=None, file="a.csv")
    >>> time_s.tolist(), unit
    ([0.0, 0.02, 0.04], 'ms')
    """
    if column.dtype.kind in "mM":
        return _parse_datetimes(column), "s"
    if column.dtype == object:
        return _parse_time_texts(column, name=name, file=file), "s"
    known = column[np.isfinite(column)]
    if known.size == 0:
        raise InputError(f"{file}: column {name} contains no times; choose another --time-column")
    found = unit or time_unit_of(name) or _infer_time_unit(known, name=name, file=file)
    absolute = float(known[0]) >= _EARLIEST_UNIX_S
    if found == "unix" or (found == "s" and absolute and unit is None):
        # Large values are milliseconds, microseconds or nanoseconds.
        found = next(
            u for u in ("ns", "us", "ms", "s") if known[0] >= _EARLIEST_UNIX_S * _PER_SECOND[u]
        )
    per_second = _PER_SECOND[found]
    counts = column - known[0] if absolute and known[0] / per_second >= _EARLIEST_UNIX_S else column
    if found in ("ms", "us"):
        counts = _unwrap_counter(counts)
    return counts / per_second, found


def is_moment(value: object) -> bool:
    """Return whether a text is a date or a time of day."""
    return any(
        np.isfinite(_try_reader(reader, value)) for reader in (_parse_date_s, _parse_time_of_day_s)
    )


def _infer_time_unit(known: NDArray[np.float64], *, name: str, file: str) -> str:
    """Infer the time unit from the sampling interval."""
    if known[0] >= _EARLIEST_UNIX_S and np.ptp(known) < known[0] / 10:
        return "unix"
    steps = np.diff(known)
    steps = steps[steps > 0]
    step = float(np.median(steps)) if steps.size else 0.0
    is_integer = bool(np.all(known == np.rint(known)))
    if not is_integer or step < 1.0:
        if step <= _MAX_INTERVAL_S:
            return "s"
    elif _MAX_INTERVAL_S < step < 1000.0:
        return "ms"
    elif step >= 1000.0:
        return "us"
    raise InputError(
        f"{file}: column {name} has an interval of {step:g}, which could be seconds or "
        "milliseconds; specify the unit with --time-unit"
    )


def _unwrap_counter(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make the count continuous across 32-bit overflows."""
    wraps = np.flatnonzero(np.diff(counts) < -0.9 * _WRAP) + 1
    for row in wraps:
        counts = counts + _WRAP * (np.arange(counts.size) >= row)
    return counts


def _parse_datetimes(column: NDArray[Any]) -> NDArray[np.float64]:
    missing = np.isnat(column)
    first = column[np.argmin(missing)]
    result = (column - first) / np.timedelta64(1, "ns") / 1e9
    return np.where(missing, np.nan, result)


def _parse_time_texts(column: NDArray[Any], *, name: str, file: str) -> NDArray[np.float64]:
    """Return seconds from ISO dates, or from times of day, which may pass midnight."""
    readers: tuple[Callable[[str], float], ...] = (_parse_date_s, _parse_time_of_day_s)
    for reader in readers:
        found = np.array([_try_reader(reader, text) for text in column])
        if np.isfinite(found).sum() > 0.5 * found.size:
            start = float(found[np.isfinite(found)][0])
            found = found - start
            if reader is _parse_time_of_day_s:
                passed = np.diff(np.nan_to_num(found), prepend=0.0) < -0.5 * _DAY_S
                found = found + _DAY_S * np.cumsum(passed)
            return found
    example = next((str(text) for text in column if str(text).strip()), "")
    raise InputError(
        f"{file}: column {name} contains {example[:30]!a}, which is not a time; use numbers, or "
        "dates in the form 2024-05-31 12:30:00.5"
    )


def _try_reader(reader: Callable[[str], float], text: object) -> float:
    try:
        return reader(str(text).strip())
    except ValueError:
        return float("nan")


def _parse_date_s(text: str) -> float:
    moment = datetime.fromisoformat(text.replace(",", "."))
    # A time without a zone is used as written; daylight saving time is ignored.
    first = datetime(1970, 1, 1, tzinfo=moment.tzinfo)
    return (moment - first).total_seconds()


def _parse_time_of_day_s(text: str) -> float:
    clean = text.replace(",", ".")
    if not re.match(r"\d{1,2}:\d\d", clean):
        raise ValueError(text)
    moment = time.fromisoformat(clean if clean[2] == ":" else f"0{clean}")
    return moment.hour * 3600.0 + moment.minute * 60.0 + moment.second + moment.microsecond / 1e6
