"""Rows from CSV text: fast where all is well, one by one where something has to be explained."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.rows import REQUIRED, ROWS_AT_A_TIME, Rows, check_columns

#: No line of a holds file is longer; a file without line ends must not be read into memory whole.
LONGEST_LINE = 65536
#: Where Windows writes decimal commas, Excel's CSV has semicolons; tabs come by copy and paste.
_SEPARATORS = ",;\t"
_FAILURES = (csv.Error, EOFError, zlib.error, gzip.BadGzipFile)


@dataclass(slots=True)
class _Numbers:
    """Text into numbers, with one decimal mark for the whole file.

    Attributes
    ----------
    mark : str or None
        Point or comma; None until a number has one. A later number with the other one is refused:
        1,234 beside 0.5 would be read a thousand times too small.
    """

    mark: str | None

    def __call__(self, fields: Sequence[str]) -> NDArray[np.float64]:
        joined = "".join(fields)
        # Python reads 1_000 as a number; in a file it is a slip.
        if "_" in joined:
            raise ValueError("underscore in a number")
        for mark in ".,":
            if mark in joined:
                if self.mark not in (mark, None):
                    raise ValueError("another decimal mark")
                self.mark = mark
        if self.mark == ",":
            fields = [field.replace(",", ".") for field in fields]
        return np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))


def read_text(stream: TextIO, *, name: str) -> Iterator[Rows]:
    """Yield the rows of a CSV file piece by piece.

    Any line ends; blank lines are skipped. Columns may be separated by semicolons or tabs; numbers
    may have decimal commas then.

    Parameters
    ----------
    stream : text file
        Opened with ``newline=""``, as the csv module wants it.
    name : str
        What errors call the file.

    Raises
    ------
    InputError
        At the first line that can't be used.
    """
    try:
        line = stream.readline(LONGEST_LINE)
    except _FAILURES as broken:
        raise _unreadable(name, 1, broken) from broken
    separator = _separator(line)
    numbers = _Numbers("." if separator == "," else None)
    lines = chain([line], iter(partial(stream.readline, LONGEST_LINE), "")) if line else []
    reader = csv.reader(lines, delimiter=separator, strict=True)
    header, failure = _take(reader, 1)
    if failure is not None:
        raise _unreadable(name, 1, failure)
    if not header:
        raise InputError(f"{name}: the file is empty; it needs hold_id,time_s,value and rows")
    columns = [column.strip() for column in header[0]]
    check_columns(columns, where=f"{name} line 1")
    while failure is None:
        first_line = reader.line_num + 1
        rows, failure = _take(reader, ROWS_AT_A_TIME)
        if rows:
            one_line_each = reader.line_num - first_line + 1 == len(rows)
            yield _convert(rows, columns, first_line, numbers, plain=one_line_each, name=name)
        elif failure is None:
            return
    raise _unreadable(name, first_line + sum(map(_lines_of, rows)), failure)


def _separator(header: str) -> str:
    """Return the separator that finds the columns of a holds file; a comma where none does."""
    names = {
        separator: [name.strip(' "\r\n') for name in header.split(separator)]
        for separator in _SEPARATORS
    }
    return next((mark for mark in names if set(REQUIRED) <= set(names[mark])), ",")


def _take(reader: Iterator[list[str]], count: int) -> tuple[list[list[str]], Exception | None]:
    """Return up to `count` rows, and what went wrong after them."""
    rows: list[list[str]] = []
    try:
        for row in reader:
            rows.append(row)
            if len(rows) == count:
                break
    except _FAILURES as failure:
        return rows, failure
    return rows, None


def _unreadable(name: str, line: int, failure: Exception) -> InputError:
    if isinstance(failure, csv.Error):
        return InputError(f"{name} line {line}: not CSV ({failure}); look for an unclosed quote")
    return InputError(
        f"{name} line {line}: the gzip data are cut or damaged there; copy the file again"
    )


def _convert(
    rows: list[list[str]],
    columns: list[str],
    first_line: int,
    numbers: _Numbers,
    *,
    plain: bool,
    name: str,
) -> Rows:
    lines: Sequence[int] = range(first_line, first_line + len(rows))
    try:
        if not plain:
            raise ValueError("a field has line ends in it")
        fields = dict(zip(columns, zip(*rows, strict=True), strict=True))
        time_s, values = numbers(fields["time_s"]), numbers(fields["value"])
    except ValueError:
        rows, lines = _sift(rows, columns, first_line, numbers, name=name)
        fields = dict(
            zip(columns, zip(*rows, strict=True) if rows else [()] * len(columns), strict=True)
        )
        time_s, values = numbers(fields["time_s"]), numbers(fields["value"])
    return Rows(
        hold_id=_objects(fields["hold_id"]),
        channel=_objects(fields["channel"]) if "channel" in fields else None,
        time_s=time_s,
        values=values,
        place=lambda index: f"line {lines[index]}",
    )


def _sift(
    rows: list[list[str]], columns: list[str], first_line: int, numbers: _Numbers, *, name: str
) -> tuple[list[list[str]], list[int]]:
    """Drop blank lines, keep count of the lines, and stop at the first row that can't be used."""
    kept, lines, line = [], [], first_line
    for row in rows:
        if any(field.strip() for field in row) or len(row) == len(columns):
            _check_row(row, columns, numbers, where=f"{name} line {line}")
            kept.append(row)
            lines.append(line)
        line += _lines_of(row)
    return kept, lines


def _check_row(row: list[str], columns: list[str], numbers: _Numbers, *, where: str) -> None:
    if len(row) != len(columns):
        raise InputError(
            f"{where}: {len(row)} fields where the header has {len(columns)} "
            f"({','.join(columns)}); mend or remove the line"
        )
    for column, field in zip(columns, row, strict=True):
        if column in ("time_s", "value"):
            try:
                numbers([field])
            except ValueError:
                raise InputError(
                    f"{where}: {column} is {field[:40]!a}, not a number; mend or remove it"
                ) from None


def _lines_of(row: list[str]) -> int:
    """Return how many lines of the file a row takes: quoted fields may hold line ends."""
    return 1 + sum(len(field.splitlines()) - 1 for field in row if "\n" in field or "\r" in field)


def _objects(fields: Sequence[str]) -> NDArray[Any]:
    return np.array(fields, dtype=object)
