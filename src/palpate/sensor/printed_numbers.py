"""Lines and numbers in the text that a board prints, in common forms."""

from __future__ import annotations

import contextlib
import json
import math
import re
from typing import NamedTuple

#: Longer than any line of 64 x 64 numbers with their labels.
_LONGEST_BYTES = 1 << 16
_LINE_END = re.compile(rb"\r\n|\n\r|\n|\r")
_PLAIN = re.compile(r"[-+.\deE,;\s]*")
_BETWEEN = re.compile(r"""[,;\s|"'<>{}()\[\]]+""")
#: Colours and cursor movements of a terminal.
_ESCAPE = re.compile(r"\x1b\[[\d;?]*[A-Za-z]")
#: Beginning of a line: prefix of ESP-IDF's log, time of day, or number of a row.
_PREFIX = re.compile(
    r"^\s*([EWIDV] \(\d+\) \S+: "
    r"|\[?(\d{4}-\d\d-\d\d[T ])?\d\d?:\d\d:\d\d(\.\d+)?Z?\]?\s*(->)?"
    r"|\d+\s*:\s+(?![^:]*:))"
)
#: A quoted key, an index in brackets, or words with a number behind: "FSR 1 (GPIO36):". The
#: lengths are limited because a regular expression is slow in a long line of letters.
_LABEL = re.compile(
    r"""["'][^"']{0,40}["']\s*[:=]\s*"""
    r"""|[\[(][\d\[\](), ]{1,20}[\])]\s*[:=]\s*"""
    r"""|((?!(?:inf|nan|ovf|OL)\b)[A-Za-z_]{1,20}\s{1,3}){0,4}"""
    r"""[^\s,;:=|]{0,40}[A-Za-z_][^\s,;:=|]{0,40}"""
    r"""(\s{1,3}\#?\d{1,4})?(\s?\([^)]{0,20}\))?\s*[:=]\s*""",
)
_HEX = re.compile(r"[\dA-Fa-f]+")
_WITH_UNIT = re.compile(r"[-+]?\d[\d.]*([^\W\d_]+|%)")
#: An open pixel: Arduino prints an overflowing float as "ovf", a multimeter as "OL".
_OPEN = {"ovf": math.inf, "-ovf": -math.inf, "ol": math.inf}
_HEXADECIMAL = "is hexadecimal; print decimal numbers (Serial.print without HEX), or 0x before each"


class LineSplitter:
    """Splits received bytes into lines, which end with LF, CR, CR LF or LF CR.

    `end`: text that ends a line instead, for a board that prints no line ends.

    >>> splitter = LineSplitter()
    >>> splitter.split(b"1,2\\r"), splitter.split(b"\\n3,4"), splitter.rest
    ([b'1,2'], [], b'3,4')
    """

    def __init__(self, end: str | None = None) -> None:
        self._end = re.compile(_custom_end(end)) if end else _LINE_END
        #: The given text; None for LF and CR.
        self.end = end
        #: A CR or LF that ended the last line, if the other one may follow.
        self._half_end = b""
        #: The beginning of a line.
        self.rest = b""
        #: Whether a line has ended.
        self.has_ended = False

    def clear(self) -> None:
        """Forget the beginning of a line."""
        self.rest = self._half_end = b""

    def split(self, data: bytes) -> list[bytes]:
        """Append bytes and return the completed lines, without their ends.

        Raises `ValueError` if a line is too long.
        """
        if self._half_end and data:
            if self._half_end + data[:1] in (b"\r\n", b"\n\r"):
                data = data[1:]
            self._half_end = b""
        *lines, self.rest = self._end.split(self.rest + data)
        if lines:
            self.has_ended = True
            if not self.rest and data[-1:] in (b"\r", b"\n") and not _ends_with_pair(data):
                self._half_end = data[-1:]
        elif len(self.rest) > _LONGEST_BYTES:
            self.rest = self.rest[-_LONGEST_BYTES // 2 :]
            raise ValueError
        return lines


def _custom_end(end: str) -> bytes:
    """Return a pattern for the end of a line; a bracket stays in it."""
    pattern = re.escape(end.encode())
    return rb"(?<=" + pattern + rb")" if end in "]})" else pattern


def _ends_with_pair(data: bytes) -> bool:
    """Return whether the last CR or LF is the second half of a line end."""
    ends = len(data) - len(data.rstrip(b"\r\n"))
    return len(_LINE_END.findall(data[-ends:])[-1]) == 2


class PrintedNumbers(NamedTuple):
    """The numbers of a line in order, and the count of decimal points."""

    values: list[float]
    points: int


def read_numbers(line: bytes, *, wanted: int | None = None) -> PrintedNumbers:
    """Return the numbers of a line, if any.

    Numbers are separated by commas, semicolons, bars or spaces. Labels, keys, brackets and a time
    of day are ignored.

    `wanted`: number of readings. If an object in JSON contains more, but only one list or object
        inside it has as many, only this is returned.
    Raises `ValueError` with the fault if the line contains anything else.

    >>> read_numbers(b"FSR 1 (A0): 512 | FSR 2 (A1): inf").values, read_numbers(b"-----").values
    ([512.0, inf], [])
    >>> read_numbers(b'{"t": 81, "p0": [[1, 2], [3, 4.5]]}', wanted=4)
    PrintedNumbers(values=[1.0, 2.0, 3.0, 4.5], points=1)
    """
    text = _decode(line)
    is_plain = _PLAIN.fullmatch(text) is not None
    if not is_plain:
        text = text.strip()
        if text.startswith("{") and '":' in text.replace(" ", ""):
            return PrintedNumbers(_read_json(text, wanted), text.count("."))
        if ":" in text or "=" in text:
            text = _LABEL.sub(" ", _PREFIX.sub("", text))
    fields = [field for field in _BETWEEN.split(text) if field]
    if not any(map(_may_contain_reading, fields)):
        return PrintedNumbers([], 0)
    points = text.count(".")
    if is_plain:
        # Much faster; `float` accepts more than numbers, but not of these characters.
        with contextlib.suppress(ValueError):
            return PrintedNumbers([float(field) for field in fields], points)
    return PrintedNumbers(_read_fields(fields), points)


def _may_contain_reading(field: str) -> bool:
    return any(map(str.isdigit, field)) or field.lower().lstrip("+-") in ("nan", "inf", *_OPEN)


def _decode(line: bytes) -> str:
    text = line.decode("utf-8", errors="replace").strip("\0\ufeff")
    if text.isascii() and text.isprintable():
        return text
    text = _ESCAPE.sub("", text)
    # A line that ends with another text can contain line ends.
    if "\ufffd" in text or not " ".join(text.split()).isprintable():
        raise ValueError("is not text; check the baud rate (baud in the rig file)")
    return text


def _read_fields(fields: list[str]) -> list[float]:
    """Convert hexadecimal numbers and names of open pixels too; raise an error with the fault."""
    if all(map(_HEX.fullmatch, fields)) and any(map(str.isalpha, "".join(fields))):
        raise FormError(_HEXADECIMAL)
    return [_read_field(field) for field in fields]


def _read_field(field: str) -> float:
    try:
        # `float` also accepts digits with underscores.
        return float(field.replace("_", "?"))
    except ValueError:
        pass
    word = field.lower()
    if word in _OPEN:
        return _OPEN[word]
    if word in ("null", "none"):
        return math.nan
    if word.startswith("0x") and _HEX.fullmatch(field[2:]):
        return float(int(field, 16))
    if found := _WITH_UNIT.fullmatch(field):
        raise ValueError(f'has "{found[1]}" after a number; print the number alone')
    raise ValueError(f'is not a line of numbers ("{field[:20]}"); print only numbers')


class FormError(ValueError):
    """A line whose form shows that other lines can be misread, although they seem valid."""


def _read_json(text: str, wanted: int | None) -> list[float]:
    try:
        found = json.loads(text)
    except ValueError:
        # Arduino's words for floats that are no numbers are not valid JSON.
        words = re.sub(r"\bnan\b", "NaN", re.sub(r"\b(inf|ovf|OL)\b", "Infinity", text))
        try:
            found = json.loads(words)
        except ValueError:
            raise ValueError("is not a complete object in JSON") from None
    values = _flatten(found)
    if wanted is not None and len(values) != wanted:
        fitting = [inner for inner in _inner_values(found) if len(inner) == wanted]
        if len(fitting) == 1:
            return fitting[0]
    return values


def _flatten(found: object) -> list[float]:
    """Return all numbers in their order; null is NaN."""
    if isinstance(found, dict | list):
        parts = found.values() if isinstance(found, dict) else found
        return [value for part in parts for value in _flatten(part)]
    if found is None:
        return [math.nan]
    is_number = isinstance(found, int | float) and not isinstance(found, bool)
    return [float(found)] if is_number else []  # type: ignore[arg-type]


def _inner_values(found: object) -> list[list[float]]:
    """Return the numbers of each list and object inside an object."""
    if not isinstance(found, dict):
        return []
    inner = [part for part in found.values() if isinstance(part, dict | list)]
    return [_flatten(part) for part in inner] + [
        values for part in inner for values in _inner_values(part)
    ]
