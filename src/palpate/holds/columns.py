"""Recognition of a table's columns from their names and units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.moments import parse_datetimes, parse_moments
from palpate.holds.units import (
    CONDUCTANCES,
    PER_SECOND,
    TIME_UNITS,
    UNITS,
    NamedUnit,
    Unit,
    find_bracketed_unit,
    find_brackets,
    find_unit,
    find_unreadable_unit,
)

TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns", "unix"]

_CLOCKS = {
    "time",
    "t",
    "timestamp",
    "ts",
    "stamp",
    "datetime",
    "epoch",
    "unixtime",
    "date",
    "elapsed",
    "clock",
    "zeit",
    "zeitstempel",
}
_CLOCKS |= {"x_value", "prüfzeit", "testzeit", "uhrzeit", "datum", "timecode"}
#: Words of a clock's name besides the word for time: at most this many.
_MOST_CLOCK_WORDS = 4
_UNIT_WORDS: dict[Unit, set[str]] = {
    "ohm": {"ohm", "ohms", "ω", "resistance", "r", "widerstand"},
    "percent": {"percent", "%", "relative", "rel"},
    "counts": {"counts", "adc", "raw", "analog"},
    "volt": {"v", "volt", "volts", "voltage"},
    "newton": {"n", "newton", "newtons"},
    "pascal": {"pa", "pascal", "pascals"},
}
_PREFIXED = re.compile(
    r"(?<![^\W\d_])(?:([GMKkmuµμ])(?: )?(?i:(ohms?|Ω|\u2126)|(v|volts?)|(n|newtons?)|(pa|pascals?))"
    r"|(c ?N|da ?N|d ?N|h ?Pa))"
    r"(?![^\W\d_])"
)
#: Last word of a name that is a unit of weight, such as load_g.
_WEIGHT = re.compile(r"[ _](mg|g|gf|kg|kgf|lbf?|lbs|oz)$")
#: Words of a function of a reading, which is in another unit than the reading.
_LOG_WORDS = {"log", "ln", "lg", "exp", "sqrt"}
_RATIO_WORDS = {"norm", "normed", "normalized", "normalised", "normiert", "ratio", "reciprocal"}
#: Signs of one: R/R0, dR/dt, 1/R, R², R^2, dB.
_FUNCTION = re.compile(
    r"(?<![^\W_])[dΔ∆δ]?([^\W\d_])\w* ?/ ?[dΔ∆δ]?(\1|t\b)|(?<![\w.])1 ?/|[²³]|\^|\bdB",
    re.IGNORECASE,
)
#: A note such as "(S/N: 204)" or "(mean N=5)", whose letters are no units.
_NOTE = re.compile(r"[\[(][^\])]*[:#=]\s*\w*\d[^\])]*[\])]|\bS/N\b", re.IGNORECASE)
_READINGS = {"value", "values", "reading", "readings", "sensor", "signal", "fsr", "velostat"}
_READINGS |= {"pixel", "taxel", "pressure", "conductance", "ch", "channel", "s", "p", "wert"}
#: Columns that often accompany sensor readings but are not sensor readings.
_OTHERS = {"force", "load", "weight", "newton", "n", "temperature", "temp", "humidity", "index"}
_OTHERS |= {"displacement", "position", "distance", "width", "sample", "sequence", "id", "row"}
_OTHERS |= {"phase", "touch", "trial", "label", "moving", "oversampling", "current", "ma", "mm"}
_OTHERS |= {"date", "count", "number", "no", "unnamed", "event", "events", "location"}
_OTHERS |= {"strain", "extension", "elongation", "travel", "crosshead", "stroke", "depth", "speed"}
_OTHERS |= {"dehnung", "weg", "kraft", "standardkraft", "kg", "grams", "angle", "cycle", "cycles"}
_OTHERS |= {
    "duration",
    "dauer",
    "batterie",
    "akku",
    "vbat",
    "vbatt",
    "bat",
    "supply",
    "vcc",
    "temperatur",
    "feuchte",
}
#: Settings of an instrument.
_OTHERS |= {"range", "bereich", "messbereich", "gain", "threshold", "setpoint", "limit", "ref"}
_OTHERS |= {"battery", "total", "step", "segment", "block", "pass", "line", "seq", "nr", "rssi"}
#: Scatter of the readings beside them, in a table of means.
_OTHERS |= {"spread", "std", "sd", "stdev", "stddev", "sigma", "deviation", "uncertainty", "noise"}
_OTHERS |= {"error", "err", "streuung", "standardabweichung"}
#: Columns that number or mark rows.
_INDICES = {"index", "sample", "sequence", "id", "row", "count", "number", "no", "unnamed", "trial"}
_INDICES |= {"phase", "touch", "label", "moving", "oversampling", "event", "events", "cycle"}
_INDICES |= {"cycles", "step", "segment", "block", "line", "seq", "nr"}
#: Words for a load, which is predicted only in a table without other readings.
_LOADS = {"force", "load", "weight", "newton", "newtons", "n", "kraft", "standardkraft", "kn"}
_LOADS |= {"gram", "grams", "kg"}
#: Columns that name the sensor of a row.
_SENSORS = {"sensor", "channel", "ch", "pin", "pad", "taxel", "pixel", "node", "probe", "kanal"}
_SENSORS |= {"signal", "name", "label", "variable", "topic", "measurement", "device", "id", "slot"}
_NUMBERED = {"id", "no", "nr", "number", "index", "name", "address"}
_RUN_COLUMNS = ("recording_id", "recording", "run_id", "run", "trial_id", "session", "hold_id")

#: Unix times of 1973 and later, in seconds; each finer unit is a thousand times larger.
_EARLIEST_UNIX_S = 1e8
#: The year 2000 in ns since 1970; ticks of 100 ns of Windows and .NET are below.
_EARLIEST_NS = 9.467e17
#: A board's 32-bit clock wraps to 0 after 71 min in microseconds, 49 days in milliseconds.
_WRAP = 2.0**32
#: A count kept in an `unsigned int` of an 8-bit board wraps after 65.5 s in milliseconds.
_SHORT_WRAP = 2.0**16
#: Longest interval between readings at which holds are recorded, seconds.
_MAX_INTERVAL_S = 4.0
#: Shortest interval that may be in seconds: no logger of a sensor is faster.
_MIN_INTERVAL_S = 5e-5
#: Days since 1900 (spreadsheets) and since the year 0 (MATLAB) of the years 1954 to 2119.
_DAY_NUMBERS = ((2e4, 8e4), (7.137e5, 7.74e5))
#: Units of clocks that can't be converted.
_UNKNOWN_TIMES = re.compile(r"[cd]s|ticks?|frames?|samples?|counts?|cycles?", re.IGNORECASE)
#: A date and time of day as one number, such as 20240531123000.
_DIGITS_OF_DATE = (1.9e13, 2.1e13)


def split_words(name: str) -> list[str]:
    """Split a column's name into lower-case words and numbers.

    >>> split_words("timeMs"), split_words("Resistance [kΩ]"), split_words("r0c1_ohm")
    (['time', 'ms'], ['resistance', 'kω'], ['r', '0', 'c', '1', 'ohm'])
    """
    separated = re.sub(r"([a-z])([A-Z])", r"\1 \2", _NOTE.sub(" ", name))
    return re.findall(r"\d+|%|[^\W\d_]+", separated.lower())


def time_unit_of(name: str) -> str | None:
    """Return a clock column's unit: "" without a unit, None for other columns.

    >>> [time_unit_of(name) for name in ("time_s", "millis", "Time [ms]", "timestamp", "force_n")]
    ['s', 'ms', 'ms', '', None]
    """
    # A second column of this name has its place appended.
    name = re.sub(r" \(\d+\)$", "", name)
    words = split_words(name)
    if not words or find_bracketed_unit(name) is not None:
        return None
    clock = name.lower() in _CLOCKS or any(word in _CLOCKS for word in words)
    words_after = {*words[1:]} - _CLOCKS
    unit = next((TIME_UNITS[word] for word in reversed(words) if word in TIME_UNITS), None)
    # A column named min is likely to be a minimum.
    if unit is not None and (clock or (len(words) == 1 and unit not in ("min", "h", "d"))):
        return unit
    return "" if clock and len(words) <= _MOST_CLOCK_WORDS and not words_after & _OTHERS else None


def bracketed_time_unit(name: str) -> str | None:
    """Return the unit of time in the last brackets of a name in any language.

    >>> bracketed_time_unit("Tiempo (min)"), bracketed_time_unit("R (kOhm)")
    ('min', None)
    """
    return next((TIME_UNITS.get(text.lower()) for text in find_brackets(name)[-1:]), None)


def find_clocks(names: Sequence[str]) -> list[str]:
    """Return the names of the clock columns; columns with a unit come first, dates last.

    >>> find_clocks(["Date", "time", "ms", "force"])
    ['ms', 'time', 'Date']
    """
    units = {name: time_unit_of(name) for name in names}
    clocks = [name for name, unit in units.items() if unit is not None]
    return sorted(
        clocks, key=lambda name: (units[name] == "", bool({"date", "datum"} & {*split_words(name)}))
    )


def unit_of(name: str) -> Unit | None:
    """Return the unit in a reading's name, if any.

    >>> [unit_of(name) for name in ("R1", "resistance_ohm", "A0", "ch1_V", "value")]
    ['ohm', 'ohm', 'counts', 'volt', None]
    """
    known = find_named_unit(name)
    if known is not None:
        return known.quantity
    words = split_words(name)
    if len(words) == 2 and words[0] == "a" and words[1].isdigit():
        return "counts"
    found = [unit for word in reversed(words) for unit in _UNIT_WORDS if word in _UNIT_WORDS[unit]]
    # The last word takes precedence, so r0c0_counts is in counts.
    exact = [unit for unit in found if words[-1] in _UNIT_WORDS[unit]]
    return next(iter(exact or found), None)


def scale_of(name: str) -> float:
    """Return the factor of the unit in a name; default 1.

    >>> [scale_of(name) for name in ("S1 [kOhm]", "R (MΩ)", "ch1_mV", "p_kPa", "resistance_ohm")]
    [1000.0, 1000000.0, 0.001, 1000.0, 1.0]
    >>> scale_of("weight [g]")
    0.00980665
    """
    known = find_named_unit(name)
    return 1.0 if known is None else known.factor


def find_named_unit(name: str) -> NamedUnit | None:
    """Return the unit in a name, if any; a function of a reading has another quantity."""
    bracketed = find_bracketed_unit(name)
    if is_function(name):
        return NamedUnit(quantity=None)
    if bracketed is not None:
        return bracketed
    found = _PREFIXED.findall(re.sub(r"([a-z])([A-Z])", r"\1 \2", name))
    if found:
        prefix, *words, whole = found[-1]
        if whole:
            return find_unit(whole.replace(" ", ""))
        return find_unit(
            prefix + ("ohm", "V", "N", "Pa")[[bool(word) for word in words].index(True)]
        )
    weight = _WEIGHT.search(name)
    if weight:
        return find_unit(weight[1])
    # A column may have the name of its unit; one letter is more often the name of a sensor.
    return find_unit(name) if name in UNITS and (len(name) > 1 or name in "NgVΩ%") else None


def is_function(name: str) -> bool:
    """Return whether a column is a function of a reading, such as a logarithm or a ratio.

    >>> [is_function(name) for name in ("ln_R_ohm", "R/R0", "dR/R0 [%]", "R/kOhm", "R (N/mm²)")]
    [True, True, False, False, False]
    """
    unit, words = find_bracketed_unit(name), {*split_words(name)}
    if find_unit(name) is not None or (unit is not None and unit.quantity == "percent"):
        return False
    # The signs of a unit in brackets, such as N/mm², are its own.
    plain = _NOTE.sub(" ", name) if unit is None else re.sub(r"[\[(<{].*?[\])>}]", " ", name)
    is_ratio = unit is None and bool(_RATIO_WORDS & words)
    return is_ratio or bool(_LOG_WORDS & words) or _FUNCTION.search(plain) is not None


def is_load(name: str) -> bool:
    """Return whether a column is a force, a weight or a pressure in pascal.

    >>> [is_load(name) for name in ("force_n", "Weight [g]", "R_ohm", "Strain [mm]")]
    [True, True, False, False]
    """
    known = find_named_unit(name)
    if known is not None:
        return known.quantity in ("newton", "pascal")
    return bool(_LOADS & {*split_words(name)})


def is_index(name: str) -> bool:
    """Return whether a column numbers or marks rows.

    >>> is_index("Sample No."), is_index("temperature")
    (True, False)
    """
    return bool(_INDICES & {*split_words(name)})


def names_sensor(name: str) -> bool:
    """Return whether a column is likely to name the sensor of each row."""
    words = {*split_words(name)} - _NUMBERED
    return name.lower() in _SENSORS or (bool(words) and words <= _SENSORS)


def _is_other(name: str) -> bool:
    known = find_bracketed_unit(name)
    # Cells or a header in ohm show that a column "Sample" has samples and no numbers of rows.
    others = _OTHERS - (_INDICES if known is not None and known.quantity == "ohm" else set())
    is_conductance = bool(CONDUCTANCES & {*find_brackets(name)})
    is_other = known is not None and known.quantity is None and not is_conductance
    return is_other or bool(others & {*split_words(name)})


def match_name(names: Iterable[str], wanted: str) -> str | None:
    """Return a column of a name, also without its unit or in another case if that is unique.

    >>> match_name(["Time [ms]", "FSR [LSB]"], "fsr"), match_name(["R (1)", "R (2)"], "R")
    ('FSR [LSB]', None)
    """
    names = [*names]
    if wanted in names:
        return wanted
    plain = [name for name in names if _plain_name(name) == _plain_name(wanted)]
    return plain[0] if len(plain) == 1 else None


def _plain_name(name: str) -> str:
    return re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", name).strip().lower()


def find_readings(names: Sequence[str]) -> list[str]:
    """Return the names of the columns with sensor readings.

    Columns with common names for readings take precedence; if there are none, every column without
    another known meaning is used, then every force. Counts are omitted if the same pixel has a
    column in ohm.

    >>> find_readings(["resistance_ohm", "force_n"]), find_readings(["left", "right", "temp_c"])
    (['resistance_ohm'], ['left', 'right'])
    >>> find_readings(["r0c0_counts", "r0c0_ohm"]), find_readings(["Force [N]", "Travel [mm]"])
    (['r0c0_ohm'], ['Force [N]'])
    """
    plain = [name for name in names if not _is_other(name) and not is_load(name)]
    named = [name for name in plain if unit_of(name) or _READINGS & {*split_words(name)}]
    found = named or plain or [name for name in names if is_load(name)]
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
        return parse_datetimes(column), "s"
    if column.dtype == object:
        seconds = parse_moments(column.tolist(), name=name, file=file)
        if seconds is None:
            example = next((str(text) for text in column if str(text).strip()), "")
            raise InputError(
                f"{file}: column {name} contains {example[:30]!a}, which is not a time; use "
                "numbers, or dates in the form 2024-05-31 12:30:00.5"
            )
        return seconds, "s"
    known = column[np.isfinite(column)]
    if known.size == 0:
        raise InputError(f"{file}: column {name} contains no times; choose another --time-column")
    if unit is None:
        _check_clock(known, name=name, file=file)
    found = unit or time_unit_of(name) or bracketed_time_unit(name)
    found = found or _infer_time_unit(known, name=name, file=file)
    absolute = float(known[0]) >= _EARLIEST_UNIX_S
    if found == "unix" or (found == "s" and absolute and unit is None):
        # Large values are milliseconds, microseconds or nanoseconds.
        found = next(
            u for u in ("ns", "us", "ms", "s") if known[0] >= _EARLIEST_UNIX_S * PER_SECOND[u]
        )
        if found == "ns" and known[0] < _EARLIEST_NS:
            raise InputError(
                f"{file}: column {name}: {known[0]:.0f} may be ticks of 100 ns; write the times in "
                "seconds, or say --time-unit ns"
            )
    per_second = PER_SECOND[found]
    counts = column - known[0] if known[0] / per_second >= _EARLIEST_UNIX_S else column
    if found in ("ms", "us"):
        counts = _unwrap_counter(counts)
    return counts / per_second, found


def _check_clock(known: NDArray[np.float64], *, name: str, file: str) -> None:
    """Raise `InputError` if a clock's unit can't be converted, or it isn't a count."""
    bracketed = [text for text in find_brackets(name) if _UNKNOWN_TIMES.fullmatch(text)]
    unknown = find_unreadable_unit(name) or next(iter(bracketed), None)
    if unknown is not None:
        raise InputError(
            f"{file}: column {name}: times in {unknown!a} can't be converted; convert them to "
            "seconds, or choose another --time-column"
        )
    low, high = _DIGITS_OF_DATE
    parts = known[:50] % 1e10
    is_date = bool((known >= low).all() and (known < high).all() and (parts % 100 < 60).all())
    if is_date and (parts // 1e8 <= 12).all() and (parts % 1e4 < 6e3).all():
        raise InputError(
            f"{file}: column {name}: {known[0]:.0f} seems to be a date and a time of day; write "
            "it in the form 2024-05-31 12:30:00.5"
        )


def _check_hms(known: NDArray[np.float64], *, name: str, file: str) -> None:
    """Raise `InputError` if a clock seems to be hours, minutes and seconds in one number."""
    steps = np.diff(known)
    seconds, minutes = known % 1e2, known // 1e2 % 1e2
    is_fast = steps.size > 0 and 0.0 < float(np.median(steps)) < 20.0
    # Seconds would pass 60 to 99, and hours and minutes skip them.
    if is_fast and (steps >= 40.0).any() and (seconds < 60).all() and (minutes < 60).all():
        raise InputError(
            f"{file}: column {name}: {known[0]:.6g} seems to be hours, minutes and seconds in one "
            "number; write it in the form 12:30:00.5, or give --time-unit"
        )


def _infer_time_unit(known: NDArray[np.float64], *, name: str, file: str) -> str:
    """Infer the time unit from the sampling interval."""
    if known[0] >= _EARLIEST_UNIX_S and np.ptp(known) < known[0] / 10:
        return "unix"
    _check_hms(known, name=name, file=file)
    steps = np.diff(known)
    steps = steps[steps > 0]
    step = float(np.median(steps)) if steps.size else 0.0
    is_integer = bool(np.all(known == np.rint(known)))
    if 0.0 < step < _MIN_INTERVAL_S:
        if any(low <= known[0] < high for low, high in _DAY_NUMBERS):
            return "d"
        raise InputError(
            f"{file}: column {name} has an interval of {step:g}, which is too short for seconds; "
            "it may be in hours or days: convert the times to seconds"
        )
    if not is_integer or step < 1.0:
        if step <= _MAX_INTERVAL_S:
            return "s"
    elif _MAX_INTERVAL_S < step < 1000.0:
        return "ms"
    elif step >= 1000.0:
        return "us" if step <= _MAX_INTERVAL_S * 1e6 else "ns"
    raise InputError(
        f"{file}: column {name} has an interval of {step:g}, which could be seconds or "
        "milliseconds; specify the unit with --time-unit"
    )


def _unwrap_counter(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make the count continuous across overflows of 16 and 32 bits."""
    steps = np.diff(counts)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for wrap in (_SHORT_WRAP, _WRAP):
        if counts.size and np.nanmax(counts) < wrap:
            # The step across the overflow is as long as the others.
            rows = np.flatnonzero((steps < -0.9 * wrap) & (steps + wrap <= 10.0 * usual)) + 1
            for row in rows:
                counts = counts + wrap * (np.arange(counts.size) >= row)
            break
    return counts
