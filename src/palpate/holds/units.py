"""Units in the names of columns and in rows of units."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, TypeAlias

Unit: TypeAlias = Literal["ohm", "percent", "counts", "volt", "newton", "pascal"]

#: SI prefixes of the units that accept one; a cell may have one alone (6.2k).
PREFIXES = {"G": 1e9, "M": 1e6, "K": 1e3, "k": 1e3, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6}
#: A unit as written -> quantity and factor. Letters are as written, because a case matters: N and
#: n, mm and MM are the exceptions that `find_unit` accepts.
_GRAVITY = 9.80665
_PLAIN: dict[str, tuple[Unit, float]] = {
    **dict.fromkeys(("ohm", "ohms", "Ohm", "Ohms", "OHM", "Ω", "\u2126"), ("ohm", 1.0)),
    **dict.fromkeys(("%", "percent"), ("percent", 1.0)),
    **dict.fromkeys(("count", "counts", "adc", "ADC", "raw", "LSB", "digits"), ("counts", 1.0)),
    **dict.fromkeys(("V", "volt", "volts", "Volt", "Volts", "v"), ("volt", 1.0)),
    **dict.fromkeys(("N", "newton", "newtons", "Newton", "Newtons"), ("newton", 1.0)),
    **dict.fromkeys(("Pa", "pascal", "pascals", "pa"), ("pascal", 1.0)),
    **dict.fromkeys(("g", "gf", "gram", "grams", "gr"), ("newton", 1e-3 * _GRAVITY)),
    **dict.fromkeys(("kg", "kgf", "Kg", "KG", "kp"), ("newton", _GRAVITY)),
    **dict.fromkeys(("lb", "lbs", "lbf"), ("newton", 0.45359237 * _GRAVITY)),
    **dict.fromkeys(("oz", "ozf"), ("newton", 0.45359237 * _GRAVITY / 16)),
    "mg": ("newton", 1e-6 * _GRAVITY),
    "cN": ("newton", 0.01),
    "dN": ("newton", 0.1),
    "daN": ("newton", 10.0),
    "hPa": ("pascal", 100.0),
    **dict.fromkeys(("N/m²", "N/m2", "N/m^2"), ("pascal", 1.0)),
    **dict.fromkeys(("N/cm²", "N/cm2", "N/cm^2"), ("pascal", 1e4)),
    **dict.fromkeys(("N/mm²", "N/mm2", "N/mm^2"), ("pascal", 1e6)),
    **{
        f"{mass}/{area}": ("pascal", factor * _GRAVITY)
        for masses, factor in ((("kg", "kgf", "kp"), 1e4), (("g", "gf"), 10.0))
        for mass in masses
        for area in ("cm²", "cm2", "cm^2")
    },
    "atm": ("pascal", 101325.0),
    "Torr": ("pascal", 133.322),
    "cmH2O": ("pascal", 98.0665),
    "inHg": ("pascal", 3386.39),
    "mbar": ("pascal", 100.0),
    "bar": ("pascal", 1e5),
    "psi": ("pascal", 6894.757),
    "PSI": ("pascal", 6894.757),
    "mmHg": ("pascal", 133.322),
}
_WITH_PREFIX = ("ohm", "ohms", "Ohm", "Ohms", "OHM", "Ω", "\u2126", "V", "v", "N", "Pa", "pa")
_PREFIXED = {
    f"{prefix}{unit}": (_PLAIN[unit][0], factor)
    for prefix, factor in PREFIXES.items()
    for unit in (*_WITH_PREFIX, "volt", "volts", "newton", "newtons", "pascal", "pascals")
}
UNITS: dict[str, tuple[Unit, float]] = {**_PREFIXED, **_PLAIN}
#: Units of quantities that are not readings of a pressure sensor.
OTHER_UNITS = {"%RH", "1/s", "A", "bit", "bits", "C", "cm", "dB", "deg", "deg.C", "degC", "degF"}
OTHER_UNITS |= {"F", "H", "Hz", "in", "inch", "J", "K", "kHz", "lux", "lx", "m", "m/s", "m/s2"}
OTHER_UNITS |= {"m/s²", "mA", "MHz", "mil", "mm", "mm/min", "mm/mm", "mm/s", "mm2", "mm²"}
OTHER_UNITS |= {"mW", "N/m", "N/mm", "nA", "nF", "Nm", "nm", "N·m", "pF", "rad", "rpm"}
OTHER_UNITS |= {"uA", "uF", "um", "W", "°", "°C", "°F", "µA", "µF", "µm", "μm", "℃"}
#: Units of conductance, which rises with the load; such a column is a reading without a unit.
CONDUCTANCES = {"S", "mS", "uS", "µS", "μS", "nS"}
OTHER_UNITS |= CONDUCTANCES
_TIME_UNITS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "msecs", "millis", "millisec", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "usecs", "micros", "microsec", "microsecond", "microseconds"),
    "ns": ("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanosecond", "nanoseconds"),
    "min": ("min", "mins", "minute", "minutes"),
    "h": ("h", "hr", "hour", "hours"),
    "d": ("d", "day", "days"),
    "unix": ("unix", "epoch"),
}
#: Word -> unit of time.
TIME_UNITS = {word: unit for unit, words in _TIME_UNITS.items() for word in words}
PER_SECOND = {
    "d": 1 / 86400,
    "h": 1 / 3600,
    "min": 1 / 60,
    "s": 1.0,
    "ms": 1e3,
    "us": 1e6,
    "ns": 1e9,
}
#: Fields of a row of units for columns without one; Campbell loggers write TS and RN.
_NO_UNITS = {"", "-", "1", "TS", "RN"}
_BRACKETS = re.compile(r"[\[(<{]\s*([^\[\](){}<>]{1,16}?)\s*[\])>}]")


#: A prefix alone, or a number next to a unit.
_MULTIPLE = re.compile(
    r"[GMKkmuµμ]|(?:[x*×·] *)?\d[\d.,/^e+-]*(?: *[x*×·])? *[^\W\d]+|[^\W\d]+ *[x*×·/] *\d[\d.,^]*"
)


#: A part of a name that isn't a unit of ours, but has the form of one: a prefix with a sign that
#: another encoding made of an ohm.
_GARBLED = re.compile("[GMKkmuµμ][\x80-\u024f\u0370-\u03ff\u2000-\u2122\u25a0-\u25ff\ufffd]{1,3}")
#: A label in brackets in a Latin alphabet, such as "außen".
_LABEL = re.compile(r"[ -~À-ÖØ-öø-ž]{4,}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedUnit:
    """A unit's quantity (None for other quantities), and factor to its basic unit."""

    quantity: Unit | None
    factor: float = 1.0


def find_unit(text: str) -> NamedUnit | None:
    """Return the unit that a text is, or None; brackets around it are ignored.

    >>> find_unit("kPa"), find_unit("[mm]"), find_unit("Force")
    (NamedUnit(quantity='pascal', factor=1000.0), NamedUnit(quantity=None, factor=1.0), None)
    """
    word = text.strip().strip("[](){}<>").strip()
    for known in (word, word.lower(), word.replace("-", "")):
        if known in UNITS:
            quantity, factor = UNITS[known]
            return NamedUnit(quantity=quantity, factor=factor)
        if known in OTHER_UNITS:
            return NamedUnit(quantity=None)
    return None


def find_brackets(name: str) -> list[str]:
    """Return the texts in the brackets of a name."""
    return [str(text) for text in _BRACKETS.findall(name)]


def find_bracketed_unit(name: str) -> NamedUnit | None:
    """Return the unit in the last brackets of a name, if any.

    >>> find_bracketed_unit("Standard force [kN]")
    NamedUnit(quantity='newton', factor=1000.0)
    """
    found = [unit for text in find_brackets(name) if (unit := find_unit(text)) is not None]
    return found[-1] if found else None


def find_unreadable_unit(name: str) -> str | None:
    """Return a unit in a name that can't be converted, if any.

    It is a multiple of a unit, or has characters that are not understood: a file in another
    encoding may have written them for an ohm sign.

    >>> [find_unreadable_unit(name) for name in ("R [0.1 N]", "R [k]", "R [kOhm] (2)", "R_kê")]
    ['0.1 N', 'k', None, 'kê']
    """
    for text in find_brackets(name):
        words = re.findall(r"[^\W\d]+", text)
        known = [*filter(_is_known, words)]
        if _is_known(text):
            continue
        if _MULTIPLE.fullmatch(text) and (known or len(text) == 1):
            return text
        if not (text.isascii() or known or _LABEL.fullmatch(text)):
            return text
    parts = re.split(r"[\s,;_/()\[\]]+", name)
    return next((part for part in parts if _GARBLED.fullmatch(part) and not _is_known(part)), None)


def _is_known(text: str) -> bool:
    return find_unit(text) is not None or text.lower() in TIME_UNITS


def is_unit_field(text: str) -> bool:
    """Return whether a field of a header row may be a unit; a blank may.

    >>> [is_unit_field(text) for text in ("", "-", "min", "kN", "Force")]
    [True, True, True, True, False]
    """
    word = text.strip().strip("[](){}<>").strip()
    is_time = word.lower() in TIME_UNITS or word in ("hh:mm:ss", "HH:MM:SS")
    return word in _NO_UNITS or is_time or find_unit(word) is not None
