"""Layout of a text table: separator, decimal mark, header, first row of numbers."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.errors import InputError

#: Tried in this order; None is any run of spaces.
SEPARATORS = ("\t", ";", ",", "|", None)
#: Fields that mean that there is no reading.
NO_VALUE = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "inf", "-inf"})
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_MOMENT = re.compile(r"(\d{4}-\d\d-\d\d([T ].*)?)|(\d{1,2}:\d\d(:\d\d([.,]\d+)?)?)")
_UNIT_ROW = re.compile(r"[\[(]?(s|sec|ms|us|µs|v|mv|ohm|kohm|Ω|kΩ|%|n|counts?|-)?[\])]?", re.I)
#: Rows in a row that look like data where data begin.
_RUN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """How to read a table."""

    #: Between fields; None for runs of spaces.
    separator: str | None
    #: Whether numbers have commas for points.
    decimal_comma: bool
    #: As the header has them, or ``1``, ``2``, ... without a header.
    names: list[str]
    #: Index of the first row of data.
    first: int


def split_fields(line: str, separator: str | None) -> list[str]:
    """Return the fields of one line."""
    if separator is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return []


def find_form(lines: Sequence[str], *, name: str) -> Form:
    """Return the form that makes most numbers of the first lines of a file.

    Raises `InputError` if no separator gives rows of at least two fields with numbers in them.

    >>> find_form(["my log", "time;value", "0,0;5,5", "0,1;5,4"], name="a.csv").names
    ['time', 'value']
    """
    best, most = None, 0
    for separator in SEPARATORS:
        rows = [split_fields(line, separator) for line in lines]
        score, width = score_rows(rows)
        if score > most:
            best, most = (separator, rows, width), score
    if best is None:
        alone = sum(_NUMBER.fullmatch(line.strip()) is not None for line in lines) > 1
        raise InputError(
            f"{name}: one column alone; a recording needs a column of times and one of readings"
            if alone
            else f"{name}: no table found in its first lines; it should be rows of times and "
            "readings, such as time,value"
        )
    separator, rows, width = best
    return form_of_rows(rows, width, separator=separator)


def form_of_rows(rows: Sequence[Sequence[str]], width: int, *, separator: str | None) -> Form:
    """Return the form of rows that are split into fields already."""
    filled = [index for index, row in enumerate(rows) if any(field.strip() for field in row)]
    data = [index for index in filled if len(rows[index]) == width and _numbers_in(rows[index]) > 0]
    like = set(data)
    first = next(
        index
        for place, index in enumerate(filled)
        if index in like and all(later in like for later in filled[place : place + _RUN])
    )
    names = _header(rows, [index for index in filled if index < first], width)
    numbers = [f for i in data for f in rows[i] if _NUMBER.fullmatch(f.strip())]
    comma = any("," in field for field in numbers)
    return Form(separator=separator, decimal_comma=comma, names=names, first=first)


def score_rows(rows: Sequence[Sequence[str]]) -> tuple[int, int]:
    """Return how well rows make a table, 0 where they don't, and its number of columns."""
    widths = Counter(len(row) for row in rows if len(row) > 1 and _numbers_in(row) > 0)
    if not widths:
        return 0, 0
    width = max(widths, key=lambda each: (widths[each], each))
    like = [len(row) == width and _numbers_in(row) > 0 for row in rows]
    filled = [ok for ok, row in zip(like, rows, strict=True) if any(f.strip() for f in row)]
    run = any(all(filled[k : k + _RUN]) for k in range(len(filled)) if filled[k])
    if not run:
        return 0, 0
    return sum(_numbers_in(row) for row, ok in zip(rows, like, strict=True) if ok), width


def _numbers_in(row: Sequence[str]) -> int:
    """Return how many fields are numbers or moments, less those that are text; 0: no data."""
    number = text = missing = 0
    for field in row:
        stripped = field.strip()
        if _NUMBER.fullmatch(stripped) or _MOMENT.fullmatch(stripped):
            number += 1
        elif stripped.lower() in NO_VALUE:
            missing += 1
        else:
            text += 1
    return max(0, number - text) if number and number + missing > 1 else 0


def _header(rows: Sequence[Sequence[str]], above: Sequence[int], width: int) -> list[str]:
    """Return the names in the line above the data, with the units of a line of units."""
    lines = [[field.strip() for field in rows[index]] for index in above[-2:]]
    units = [""] * width
    if len(lines) == 2 and all(_UNIT_ROW.fullmatch(field) for field in lines[1]):
        units = [field.strip("[]()-") for field in _padded(lines.pop(), width)]
    if not lines or 2 * sum(map(bool, lines[-1])) < width:
        return [str(number) for number in range(1, width + 1)]
    return [
        f"{name} [{unit}]" if unit else name
        for name, unit in zip(_padded(lines[-1], width), units, strict=True)
    ]


def _padded(fields: Sequence[str], width: int) -> list[str]:
    return [*fields, *[""] * width][:width]
