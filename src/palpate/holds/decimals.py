"""Numbers as text: one decimal mark and one thousands mark for a whole file.

`60.118` may be 60.118 or 60 118. The other numbers of the file decide: a number that is possible
with one meaning only, such as `0.5` or `60,118.7`, is evidence for it. Without evidence, or with
evidence for both, the file is refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds.table import LARGEST_NUMBER
from palpate.holds.units import PREFIXES, TIME_UNITS, find_unit

MARKS = {"point": ".", "comma": ","}
#: Fields that represent a missing reading, in lower case.
MISSING = {"", "#div/0!", "#n/a", "#na", "#num!", "#ref!", "#value!", "*", "**", "***", "+nan"}
MISSING |= {"-", "--", "---", "----", "-----", "-1.#ind", "-inf", "-infinity", "-nan"}
MISSING |= {"-nan(ind)", "1.#qnan", "?", "n/a", "na", "nan", "nan(ind)", "nil", "no data"}
MISSING |= {"no reading", "none", "null"}
#: Fields that represent a reading above the range, as of a sensor without contact.
OPEN = {"+inf", "+infinity", "+ol", "+over", "+ovld", "+∞", ".ol", "0.l", "0l", "1.#inf"}
OPEN |= {">range", "inf", "infinity", "o l", "o. l", "o.l", "o.l.", "o/l", "ol", "open"}
OPEN |= {"open circuit", "out of range", "over", "over limit", "over load", "over range"}
OPEN |= {"over-range", "overflow", "overload", "overrange", "ovf", "ovfl", "ovl", "ovld"}
OPEN |= {"ovrflw", "∞"}
#: Thousands marks, and spaces between a sign and its number.
_SPACES = re.compile(r"(?<=\d)[ \u00a0\u202f\u2009'’](?=\d{3}(?:\D|$))|(?<=^[-+]) +(?=[\d.,])")
_NUMBER = re.compile(r"[-+\u2212]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?")
_CELL = re.compile(
    r"(?P<number>[-+\u2212]?[ ]*[\d.,][\d.,'’ \u00a0\u202f]*(?:[eE][-+]?\d+)?|[^\W\d]\S*(?= ))"
    r"[ \u00a0\u202f]*(?P<unit>[^\s\d.,;:(\[{<]\S{0,8})"
)
#: Groups of three digits, or of two above the thousands, as in India.
_GROUPS = {
    mark: re.compile(rf"[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{2,3}})*{re.escape(mark)}\d{{3}}")
    for mark in MARKS.values()
}


def is_number(text: str) -> bool:
    """Return whether a field is a number with any marks.

    >>> [is_number(text) for text in ("60.118,7", "60 118", "-1e3", "1_000", "12:30")]
    [True, True, True, False, False]
    """
    return _NUMBER.fullmatch(_SPACES.sub("", text.strip())) is not None


def split_cell(text: str) -> tuple[str, str] | None:
    """Return the number (or the word for a reading above the range) and the unit of a cell.

    None for other texts. The unit may be an SI prefix alone.

    >>> split_cell("12,5 N"), split_cell("6.2k"), split_cell("OL MΩ"), split_cell("3rd")
    (('12,5', 'N'), ('6.2', 'k'), ('OL', 'MΩ'), None)
    """
    found = _CELL.fullmatch(text.strip())
    if found is None:
        return None
    number, unit = found["number"].rstrip(), found["unit"]
    is_known = unit in PREFIXES or unit.lower() in TIME_UNITS or find_unit(unit) is not None
    return (number, unit) if is_known and (is_number(number) or number.lower() in OPEN) else None


def is_missing(text: str) -> bool:
    """Return whether a field stands for no reading, or for one above the range."""
    word = text.strip().lower()
    return word in MISSING or word in OPEN


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberFormat:
    """The marks of a file's numbers."""

    decimal: str = "."
    #: Mark between groups of three digits; empty if none.
    group: str = ""

    def parse(self, fields: Sequence[str]) -> FloatArray:
        """Return numbers; NaN where a field is none, infinity where it is above the range.

        >>> NumberFormat(decimal=",", group=".").parse(["60.118,7", "OL", "ERR", "-"]).tolist()
        [60118.7, inf, nan, nan]
        """
        if self.group:
            fields = [text.replace(self.group, "") for text in fields]
        if self.decimal == ",":
            fields = [text.replace(",", ".") for text in fields]
        try:
            # Python parses 1_000 as a number; in a file it is an error.
            if "_" in "".join(fields):
                raise ValueError("underscore in a number")
            numbers = np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
        except ValueError:
            numbers = np.array([_parse_number(text) for text in fields])
        numbers[~((np.abs(numbers) <= LARGEST_NUMBER) | (numbers == np.inf))] = np.nan
        return numbers


def _parse_number(text: str) -> float:
    word = text.strip()
    if word.lower() in OPEN:
        return float("inf")
    if "_" in word:
        return float("nan")
    try:
        return float(_SPACES.sub("", word).replace("\u2212", "-"))
    except ValueError:
        return float("nan")


@dataclass(slots=True, kw_only=True)
class MarkEvidence:
    """What the numbers of a file say about its marks.

    >>> evidence = MarkEvidence()
    >>> evidence.look(["0,05", "60.118"], places=["line 2", "line 3"])
    >>> evidence.decide(name="a.csv", separator=";", wanted=",").group
    '.'
    """

    #: Mark -> place and number that prove that it is the decimal mark.
    decimal: dict[str, tuple[str, str]] = field(default_factory=dict)
    #: Mark -> place and number that prove that it separates thousands.
    group: dict[str, tuple[str, str]] = field(default_factory=dict)
    #: Mark -> place and first number in which it could be either.
    either: dict[str, tuple[str, str]] = field(default_factory=dict)

    def look(self, fields: Sequence[str], *, places: Sequence[object]) -> None:
        """Add the numbers of a column."""
        together = "".join(fields)
        marks = [mark for mark in ".," if mark in together]
        if not marks or (marks == ["."] and "." in self.decimal and "," not in self.decimal):
            # The usual case needs no further evidence.
            return
        for text, place in zip(fields, places, strict=True):
            if "." in text or "," in text:
                self._look(text.strip(), place)

    def _look(self, text: str, place: object) -> None:
        digits = _SPACES.sub("", text).lstrip("+-\u2212")
        if not _NUMBER.fullmatch(digits):
            cell = split_cell(text)
            if cell is not None:
                self._look(cell[0], place)
            return
        found, seen = (str(place), text), [mark for mark in digits if mark in ".,"]
        kinds = set(seen)
        if len(kinds) == 2:
            whole, _, fraction = digits.rpartition(seen[-1])
            if seen.count(seen[-1]) == 1 and _GROUPS[seen[0]].fullmatch(whole) and fraction:
                self.decimal.setdefault(seen[-1], found)
                self.group.setdefault(seen[0], found)
        elif len(seen) > 1:
            if _GROUPS[seen[0]].fullmatch(digits):
                self.group.setdefault(seen[0], found)
        elif _GROUPS[seen[0]].fullmatch(digits):
            self.either.setdefault(seen[0], found)
        else:
            self.decimal.setdefault(seen[0], found)

    def decide(self, *, name: str, separator: str | None, wanted: str | None) -> NumberFormat:
        """Return the format of the file's numbers.

        `separator`: between fields.
        `wanted`: decimal mark given by the user.
        Raises `InputError` if the numbers contradict each other or may have two meanings.
        """
        if wanted is not None:
            other = _other(wanted)
            if other in self.decimal or wanted in self.group:
                place, text = self.decimal.get(other) or self.group[wanted]
                raise InputError(
                    f"{name} {place}: {text} contradicts --decimal; change the option, or use one "
                    "decimal mark in the whole file"
                )
            return NumberFormat(decimal=wanted, group=other)
        if len(self.decimal) == 2 or self.decimal.keys() & self.group.keys():
            self._refuse_mixed(name)
        decimal = next(iter(self.decimal), None)
        if decimal is None:
            # A mark that separates thousands leaves the other one for decimals. A point without
            # evidence is decimal, except after semicolons, which replace commas where a comma is
            # the decimal mark.
            decimal = _other(next(iter(self.group))) if self.group else "."
            unsure = "," if decimal == "." else "."
            if not self.group and "." in self.either and separator == ";":
                unsure = "."
        else:
            unsure = _other(decimal)
        if unsure in self.either and unsure not in self.group:
            place, text = self.either[unsure]
            both = f"{text.replace(unsure, '.')} or {text.replace(unsure, '')}"
            proof = self.decimal.get(decimal)
            known = f" next to {proof[1]} ({proof[0]})" if proof else ""
            words = {mark: word for word, mark in MARKS.items()}
            remedy = f"--decimal {words[_other(unsure)]} if {unsure!r} separates thousands"
            if not proof:
                remedy += f", --decimal {words[unsure]} if it is the decimal mark"
            raise InputError(
                f"{name} {place}: {text} may be {both}{known}; say {remedy}, or use one decimal "
                "mark in the whole file"
            )
        return NumberFormat(decimal=decimal, group=next(iter(self.group), ""))

    def _refuse_mixed(self, name: str) -> None:
        one, other = (
            (self.decimal["."], self.decimal[","])
            if len(self.decimal) == 2
            else next(
                (self.decimal[mark], self.group[mark])
                for mark in self.decimal.keys() & self.group.keys()
            )
        )
        raise InputError(
            f"{name}: {one[1]} ({one[0]}) and {other[1]} ({other[0]}) have different decimal "
            "marks; use one mark in the whole file"
        )


def _other(mark: str) -> str:
    return "," if mark == "." else "."
