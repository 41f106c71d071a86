"""Reader of text tables: encoding, lines, layout and conversion to columns of numbers."""

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
from palpate.holds.columns import find_recording_column
from palpate.holds.table import LONGEST_LINE, Table, is_usable, report_bad_rows

if TYPE_CHECKING:
    from _csv import Reader as CsvReader

#: Rows of fields, and for each row the number of its first line in the file.
NumberedRows: TypeAlias = tuple[list[list[str]], Sequence[int]]

#: Enough to detect the encoding, notes, header and first rows.
SAMPLE_BYTES, SAMPLE_ROWS = 65536, 400
#: Separators in the order in which they are tried; None is any run of spaces.
SEPARATORS = ("\t", ";", ",", "|", None)
#: Fields that represent a missing reading.
_NO_VALUE = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "inf", "-inf"})
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_MOMENT = re.compile(r"(\d{4}-\d\d-\d\d([T ].*)?)|(\d{1,2}:\d\d(:\d\d([.,]\d+)?)?)")
_UNIT_ROW = re.compile(r"[\[(]?(s|sec|ms|us|µs|v|mv|ohm|kohm|Ω|kΩ|%|n|counts?|-)?[\])]?", re.I)
#: Number of consecutive data rows that mark the start of the data.
_DATA_RUN = 3
_GZIP_MAGIC = b"\x1f\x8b"
_GZIP_ERRORS = (EOFError, zlib.error, gzip.BadGzipFile)
_GZIP_REMEDY = "the gzip data are truncated or damaged here; copy the file again"


@contextmanager
def open_text(file: BufferedReader, *, name: str) -> Iterator[TextIO]:
    r"""Open a file as decompressed, decoded text; ``\ufffd`` replaces bytes that can't be decoded.

    `file`: read once and in order, so it may be a pipe.
    Raises `InputError` if the file isn't text, or its gzip data are damaged.
    """
    try:
        binary = file
        if file.peek(2)[:2] == _GZIP_MAGIC:
            binary = BufferedReader(cast(RawIOBase, gzip.GzipFile(fileobj=file)), SAMPLE_BYTES)
        encoding = _encoding(binary.peek(SAMPLE_BYTES), name=name)
        with TextIOWrapper(binary, encoding=encoding, errors="replace", newline="") as text:
            yield text
    except _GZIP_ERRORS as error:
        raise InputError(f"{name} line 1: {_GZIP_REMEDY}") from error


def _encoding(start: bytes, *, name: str) -> str:
    """Return the encoding of a text from its first bytes."""
    if start[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return "utf-16"
    if b"\0" in start:
        raise InputError(
            f"{name}: not a text file; give CSV, TSV, Excel (.xlsx), Parquet or an .mcap recording"
        )
    try:
        # An incremental decoder accepts a sample that ends in the middle of a character.
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def read_lines(text: TextIO) -> Iterator[str]:
    """Return an iterator over the lines, each of at most `LONGEST_LINE` characters."""
    return iter(lambda: text.readline(LONGEST_LINE), "")


def split_lines(lines: Iterable[str], *, separator: str | None, strict: bool = False) -> CsvReader:
    """Return a reader that splits lines into fields at a separator (None: spaces)."""
    if separator is None:
        spaced = (" ".join(line.split()) for line in lines)
        return csv.reader(spaced, delimiter=" ", quoting=csv.QUOTE_NONE)
    return csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=strict)


def split_line(line: str, separator: str | None) -> list[str]:
    """Return the fields of one line; no fields if the line is not CSV."""
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
    """Yield the fields of each row, chunk by chunk; blank lines are rows without fields.

    `lines`: with line endings, as the csv module requires.
    `separator`: between fields; None for runs of spaces.
    `first_number`: number of the first line in the file.
    `strict`: whether to refuse stray and unclosed quotes.
    Raises `InputError` at a line that isn't CSV or whose gzip data are damaged, after yielding all
    previous rows.
    """
    reader = split_lines(lines, separator=separator, strict=strict)
    rows, starts, number = list[list[str]](), list[int](), first_number
    failure: Exception | None = None
    try:
        for row in reader:
            rows.append(row)
            starts.append(number)
            # Quoted fields may contain line breaks.
            number = first_number + reader.line_num
            if len(rows) == table.ROWS_AT_A_TIME:
                yield rows, starts
                rows, starts = [], []
    except (csv.Error, *_GZIP_ERRORS) as error:
        failure = error
    if rows:
        yield rows, starts
    if failure is not None:
        reason = _GZIP_REMEDY
        if isinstance(failure, csv.Error):
            reason = f"not CSV ({failure}); check for an unclosed quote"
        raise InputError(f"{name} line {number}: {reason}") from failure


def parse_numbers(fields: Sequence[str], *, comma: bool) -> FloatArray:
    """Return fields as numbers; NaN for a field that is not a usable number.

    `comma`: whether numbers have decimal commas.

    >>> parse_numbers(["1,5", "ERR", "1_000", "2e300"], comma=True).tolist()
    [1.5, nan, nan, nan]
    """
    if comma:
        fields = [field.replace(",", ".") for field in fields]
    try:
        # Python parses 1_000 as a number; in a file it is an error.
        if "_" in "".join(fields):
            raise ValueError("underscore in a number")
        numbers = np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
    except ValueError:
        numbers = np.array([_parse_number(field) for field in fields])
    numbers[~is_usable(numbers)] = np.nan
    return numbers


def _parse_number(field: str) -> float:
    try:
        return float("nan") if "_" in field else float(field)
    except ValueError:
        return float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Layout of a text table, detected from its first lines."""

    #: Separator between fields; None for runs of spaces.
    separator: str | None
    #: Whether numbers have decimal commas.
    comma: bool
    #: Column names from the header, or ``1``, ``2``, ... without a header; unique, not empty.
    names: list[str]
    #: Index of the first row of data.
    first: int
    #: Count of numbers found with this layout.
    score: int


def read_text(file: BufferedReader, *, name: str) -> Table:
    """Read a table from a text file.

    Separators are commas, semicolons, tabs, bars or spaces; numbers have decimal points or commas;
    the encoding is UTF-8, UTF-16 or a Western code page. Notes before the header and lines that
    begin with ``#``, ``%`` or ``//`` are skipped.

    Raises `InputError` if the file isn't text, contains no table, or has too many unusable rows.
    """
    with open_text(file, name=name) as text:
        # Comments become empty lines to preserve the line numbers.
        lines = ("\n" if line.startswith(("#", "%", "//")) else line for line in read_lines(text))
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
    """Return the layout that yields the most numbers in the first lines of a file.

    Raises `InputError` if no separator yields rows of at least two fields with numbers.

    >>> find_layout(["my log", "time;value", "0,0;5,5", "0,1;5,4"], name="a.csv").names
    ['time', 'value']
    """
    found = [
        detect_layout([split_line(line, separator) for line in lines], separator=separator)
        for separator in SEPARATORS
    ]
    best = max(filter(None, found), key=lambda layout: layout.score, default=None)
    if best is None:
        has_one_column = sum(_NUMBER.fullmatch(line.strip()) is not None for line in lines) > 1
        raise InputError(
            f"{name}: only one column; a recording needs a column of times and a column of readings"
            if has_one_column
            else f"{name}: no table found in the first lines; expected rows of times and "
            "readings, such as time,value"
        )
    return best


def detect_layout(rows: Sequence[Sequence[str]], *, separator: str | None = None) -> Layout | None:
    """Return the layout of rows of fields, or None if the rows form no table."""
    numbers = [_score_row(row) for row in rows]
    widths = Counter(
        len(row) for row, count in zip(rows, numbers, strict=True) if len(row) > 1 and count
    )
    width = max(widths, key=lambda each: (widths[each], each), default=0)
    filled = [index for index, row in enumerate(rows) if any(field.strip() for field in row)]
    data = {index for index in filled if len(rows[index]) == width and numbers[index]}
    starts = (
        k for place, k in enumerate(filled) if data.issuperset(filled[place : place + _DATA_RUN])
    )
    first = next(starts, None)
    if first is None:
        return None
    fields = [field for index in data for field in rows[index] if _NUMBER.fullmatch(field.strip())]
    return Layout(
        separator=separator,
        comma=any("," in field for field in fields),
        names=_parse_header([rows[index] for index in filled if index < first], width),
        first=first,
        score=sum(numbers[index] for index in data),
    )


def _score_row(row: Sequence[str]) -> int:
    """Return the excess of number and time fields over text fields; 0 if not data."""
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


def _parse_header(above: Sequence[Sequence[str]], width: int) -> list[str]:
    """Return the column names above the data, with units from a separate line if present."""
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
    chunks: Iterable[NumberedRows], layout: Layout, *, name: str, word: str = "line"
) -> Table:
    """Gather rows into a table that lists its skipped rows and its non-numeric fields.

    A column is text if at least half of its first chunk is text.

    `word` ("line" or "row"): unit of the row numbers in messages.
    Raises `InputError` if there are no rows, or too many unusable ones.
    """
    names, width = layout.names, len(layout.names)
    texts: set[str] = {find_recording_column(names) or ""}
    columns: dict[str, list[NDArray[Any]]] = {column: [] for column in names}
    non_numeric: dict[str, list[int]] = {column: [] for column in names}
    used: list[int] = []
    bad: list[tuple[str, str]] = []
    for rows, numbers in chunks:
        if set(map(len, rows)) != {width}:
            filled = [i for i, row in enumerate(rows) if any(field.strip() for field in row)]
            complete = [
                i
                for i in filled
                if len(rows[i]) >= width and not any(f.strip() for f in rows[i][width:])
            ]
            bad += [
                (f"{word} {numbers[i]}", f"{len(rows[i])} fields instead of {width}")
                for i in sorted({*filled} - {*complete})
            ]
            rows, numbers = [rows[i][:width] for i in complete], [numbers[i] for i in complete]
        for column, fields in zip(names, zip(*rows, strict=True), strict=False):
            if column in texts:
                columns[column].append(np.array(fields, dtype=object))
                continue
            parsed = parse_numbers(fields, comma=layout.comma)
            odd = [
                numbers[i]
                for i in np.flatnonzero(np.isnan(parsed)).tolist()
                if fields[i].strip().lower() not in _NO_VALUE
            ]
            if not used and 2 * len(odd) >= len(fields):
                texts.add(column)
                columns[column].append(np.array(fields, dtype=object))
            else:
                non_numeric[column] += odd
                columns[column].append(parsed)
        used += numbers
    omissions = report_bad_rows(bad, total=len(used) + len(bad), name=name)
    if not used:
        raise InputError(f"{name}: no rows of numbers; expected times and readings")
    omissions += [
        f"{column}: {len(odd)} fields are not numbers and count as missing (first at {word} "
        f"{odd[0]})"
        for column, odd in non_numeric.items()
        if odd
    ]
    return Table(
        name=name,
        columns={column: np.concatenate(parts) for column, parts in columns.items()},
        numbers=used,
        word=word,
        omissions=omissions,
    )
