"""Tables as text: encoding, lines, layout, and rows of fields into columns of numbers."""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader, RawIOBase, TextIOWrapper
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, TextIO, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds import table
from palpate.holds.columns import find_part
from palpate.holds.table import LONGEST_LINE, Table, is_usable, refuse_or_report

if TYPE_CHECKING:
    from _csv import Reader as CsvReader

#: Rows of fields, and the number of each one's first line in the file.
NumberedRows: TypeAlias = tuple[list[list[str]], Sequence[int]]

#: Enough to see encoding, notes, header and the first rows.
SAMPLE_BYTES, SAMPLE_ROWS = 65536, 400
#: Tried in this order; None is any run of spaces.
SEPARATORS = ("\t", ";", ",", "|", None)
#: Fields that mean that there is no reading.
_NO_VALUE = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "inf", "-inf"})
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_MOMENT = re.compile(r"(\d{4}-\d\d-\d\d([T ].*)?)|(\d{1,2}:\d\d(:\d\d([.,]\d+)?)?)")
_UNIT_ROW = re.compile(r"[\[(]?(s|sec|ms|us|µs|v|mv|ohm|kohm|Ω|kΩ|%|n|counts?|-)?[\])]?", re.I)
#: Rows in a row that look like data where data begin.
_RUN = 3
_GZIP_MAGIC = b"\x1f\x8b"
_BROKEN = (EOFError, zlib.error, gzip.BadGzipFile)
_MEND = "the gzip data are cut or damaged there; copy the file again"


@contextmanager
def open_text(file: BufferedReader, *, name: str) -> Iterator[TextIO]:
    r"""Open the text of a file, unpacked and decoded; ``\ufffd`` replaces what can't be decoded.

    `file`: read once and in order, so that it may be a pipe.
    Raises `InputError` if it isn't text, or the gzip data are damaged.
    """
    try:
        binary = file
        if file.peek(2)[:2] == _GZIP_MAGIC:
            binary = BufferedReader(cast(RawIOBase, gzip.GzipFile(fileobj=file)), SAMPLE_BYTES)
        encoding = _encoding(binary.peek(SAMPLE_BYTES), name=name)
        with TextIOWrapper(binary, encoding=encoding, errors="replace", newline="") as text:
            yield text
    except _BROKEN as error:
        raise InputError(f"{name} line 1: {_MEND}") from error


def _encoding(start: bytes, *, name: str) -> str:
    """Return the encoding that the first bytes fit."""
    if start[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return "utf-16"
    if b"\0" in start:
        raise InputError(
            f"{name}: not a text file; give CSV, TSV, Excel (.xlsx), Parquet or an .mcap recording"
        )
    try:
        # Incremental: a letter may be cut in two at the end of the sample.
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def lines_of(text: TextIO) -> Iterator[str]:
    """Return the lines, none of them endless."""
    return iter(lambda: text.readline(LONGEST_LINE), "")


def split_lines(lines: Iterable[str], *, separator: str | None, strict: bool = False) -> CsvReader:
    """Return what splits lines into fields at a separator; None is any run of spaces."""
    if separator is None:
        spaced = (" ".join(line.split()) for line in lines)
        return csv.reader(spaced, delimiter=" ", quoting=csv.QUOTE_NONE)
    return csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=strict)


def split_line(line: str, separator: str | None) -> list[str]:
    """Return the fields of one line; none where it is not CSV."""
    try:
        return next(split_lines([line], separator=separator), [])
    except csv.Error:
        return []


def split_rows(
    lines: Iterable[str],
    *,
    separator: str | None,
    first_number: int,
    name: str,
    strict: bool = False,
) -> Iterator[NumberedRows]:
    """Yield the fields of each row, piece by piece; blank lines are rows without fields.

    `lines`: with their ends, as the csv module wants them.
    `separator`: between fields; None for runs of spaces.
    `first_number`: number of the first line in the file.
    `strict`: whether stray and unclosed quotes are refused.
    Raises `InputError` if it isn't CSV or the gzip data are damaged, once all rows before have been
    yielded.
    """
    reader = split_lines(lines, separator=separator, strict=strict)
    rows, starts, number = list[list[str]](), list[int](), first_number
    failure: Exception | None = None
    try:
        for row in reader:
            rows.append(row)
            starts.append(number)
            # Quoted fields may hold line ends.
            number = first_number + reader.line_num
            if len(rows) == table.ROWS_AT_A_TIME:
                yield rows, starts
                rows, starts = [], []
    except (csv.Error, *_BROKEN) as error:
        failure = error
    if rows:
        yield rows, starts
    if failure is not None:
        why = _MEND
        if isinstance(failure, csv.Error):
            why = f"not CSV ({failure}); look for an unclosed quote"
        raise InputError(f"{name} line {number}: {why}") from failure


def numbers_of(fields: Sequence[str], *, comma: bool) -> FloatArray:
    """Return fields as numbers; NaN where one is no number that can be worked with.

    `comma`: whether numbers have commas for points.

    >>> numbers_of(["1,5", "ERR", "1_000", "2e300"], comma=True).tolist()
    [1.5, nan, nan, nan]
    """
    if comma:
        fields = [field.replace(",", ".") for field in fields]
    try:
        # Python reads 1_000 as a number; in a file it is a slip.
        if "_" in "".join(fields):
            raise ValueError("underscore in a number")
        numbers = np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
    except ValueError:
        numbers = np.array([_number(field) for field in fields])
    numbers[~is_usable(numbers)] = np.nan
    return numbers


def _number(field: str) -> float:
    try:
        return float("nan") if "_" in field else float(field)
    except ValueError:
        return float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Format of an undescribed table, from its text."""

    #: Between fields; None for runs of spaces.
    separator: str | None
    #: Whether numbers have commas for points.
    comma: bool
    #: As the header has them, or ``1``, ``2``, ... without a header; none empty, none twice.
    names: list[str]
    #: Index of the first row of data.
    first: int
    #: How many numbers it finds.
    score: int


def read_text(file: BufferedReader, *, name: str) -> Table:
    """Read a table from a text file.

    Commas, semicolons, tabs, bars or spaces; decimal points or commas; UTF-8, UTF-16 or a Western
    code page. Notes before the header and lines that begin with ``#``, ``%`` or ``//`` are passed
    over.

    Raises `InputError` if it isn't text, there is no table in it, or more than a few rows can't be
    used.
    """
    with open_text(file, name=name) as text:
        # Comments become empty lines, so that lines can be counted.
        lines = ("\n" if line.startswith(("#", "%", "//")) else line for line in lines_of(text))
        sample = list(islice(lines, SAMPLE_ROWS))
        layout = find_layout(sample, name=name)
        rows = split_rows(
            chain(sample[layout.first :], lines),
            separator=layout.separator,
            first_number=layout.first + 1,
            name=name,
        )
        return gather_rows(rows, layout, name=name)


def find_layout(lines: Sequence[str], *, name: str) -> Layout:
    """Return the layout that makes most numbers of the first lines of a file.

    Raises `InputError` if no separator gives rows of at least two fields with numbers in them.

    >>> find_layout(["my log", "time;value", "0,0;5,5", "0,1;5,4"], name="a.csv").names
    ['time', 'value']
    """
    found = [
        layout_of([split_line(line, separator) for line in lines], separator=separator)
        for separator in SEPARATORS
    ]
    best = max(filter(None, found), key=lambda layout: layout.score, default=None)
    if best is None:
        alone = sum(_NUMBER.fullmatch(line.strip()) is not None for line in lines) > 1
        raise InputError(
            f"{name}: one column alone; a recording needs a column of times and one of readings"
            if alone
            else f"{name}: no table found in its first lines; it should be rows of times and "
            "readings, such as time,value"
        )
    return best


def layout_of(rows: Sequence[Sequence[str]], *, separator: str | None = None) -> Layout | None:
    """Return the layout of rows split into fields, None if they form no table."""
    numbers = [_numbers_in(row) for row in rows]
    widths = Counter(
        len(row) for row, count in zip(rows, numbers, strict=True) if len(row) > 1 and count
    )
    width = max(widths, key=lambda each: (widths[each], each), default=0)
    filled = [index for index, row in enumerate(rows) if any(field.strip() for field in row)]
    data = {index for index in filled if len(rows[index]) == width and numbers[index]}
    starts = (k for place, k in enumerate(filled) if data.issuperset(filled[place : place + _RUN]))
    first = next(starts, None)
    if first is None:
        return None
    fields = [field for index in data for field in rows[index] if _NUMBER.fullmatch(field.strip())]
    return Layout(
        separator=separator,
        comma=any("," in field for field in fields),
        names=_header([rows[index] for index in filled if index < first], width),
        first=first,
        score=sum(numbers[index] for index in data),
    )


def _numbers_in(row: Sequence[str]) -> int:
    """Return the count of numeric or time fields less text fields; 0 means no data."""
    number = text = missing = 0
    for field in row:
        stripped = field.strip()
        if _NUMBER.fullmatch(stripped) or _MOMENT.fullmatch(stripped):
            number += 1
        elif stripped.lower() in _NO_VALUE:
            missing += 1
        else:
            text += 1
    return max(0, number - text) if number and number + missing > 1 else 0


def _header(above: Sequence[Sequence[str]], width: int) -> list[str]:
    """Return the names above the data, with the units of a line of units."""
    lines = [[field.strip() for field in row][:width] for row in above[-2:]]
    lines = [line + [""] * (width - len(line)) for line in lines]
    units = [""] * width
    if len(lines) == 2 and all(_UNIT_ROW.fullmatch(field) for field in lines[1]):
        units = [field.strip("[]()-") for field in lines.pop()]
    if not lines or 2 * sum(map(bool, lines[-1])) < width:
        return [str(number) for number in range(1, width + 1)]
    names: list[str] = []
    for name, unit in zip(lines[-1], units, strict=True):
        name = " ".join((f"{name} [{unit}]" if unit else name).split())
        name = name or f"column {len(names) + 1}"
        names.append(name if name not in names else f"{name} ({len(names) + 1})")
    return names


def gather_rows(
    pieces: Iterable[NumberedRows], layout: Layout, *, name: str, word: str = "line"
) -> Table:
    """Return rows as a table, with account of what couldn't be used.

    A column is text if at least half of its first piece is. `word`: what the file calls a row.

    Raises `InputError` if there is no row, or more than a few can't be used.
    """
    names, width = layout.names, len(layout.names)
    texts: set[str] = {find_part(names) or ""}
    columns: dict[str, list[NDArray[Any]]] = {column: [] for column in names}
    strange: dict[str, list[int]] = {column: [] for column in names}
    kept: list[int] = []
    bad: list[tuple[str, str]] = []
    for rows, numbers in pieces:
        if set(map(len, rows)) != {width}:
            filled = [at for at, row in enumerate(rows) if any(field.strip() for field in row)]
            whole = [
                at
                for at in filled
                if len(rows[at]) >= width and not any(f.strip() for f in rows[at][width:])
            ]
            bad += [
                (f"{word} {numbers[at]}", f"{len(rows[at])} fields instead of {width}")
                for at in sorted({*filled} - {*whole})
            ]
            rows, numbers = [rows[at][:width] for at in whole], [numbers[at] for at in whole]
        for column, fields in zip(names, zip(*rows, strict=True), strict=False):
            if column in texts:
                columns[column].append(np.array(fields, dtype=object))
                continue
            parsed = numbers_of(fields, comma=layout.comma)
            odd = [
                numbers[at]
                for at in np.flatnonzero(np.isnan(parsed)).tolist()
                if fields[at].strip().lower() not in _NO_VALUE
            ]
            if not kept and 2 * len(odd) >= len(fields):
                texts.add(column)
                columns[column].append(np.array(fields, dtype=object))
            else:
                strange[column] += odd
                columns[column].append(parsed)
        kept += numbers
    left_out = refuse_or_report(bad, total=len(kept) + len(bad), name=name)
    if not kept:
        raise InputError(f"{name}: no rows of numbers in it")
    left_out += [
        f"{column}: {len(odd)} fields are not numbers and count as missing (first at {word} "
        f"{odd[0]})"
        for column, odd in strange.items()
        if odd
    ]
    return Table(
        name=name,
        columns={column: np.concatenate(parts) for column, parts in columns.items()},
        numbers=kept,
        word=word,
        left_out=left_out,
    )
