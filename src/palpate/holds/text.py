"""Tables in text files, plain or gzipped: their lines, their rows, and what these make."""

from __future__ import annotations

import codecs
import csv
import gzip
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import BufferedReader, RawIOBase, TextIOWrapper
from itertools import accumulate, chain, islice
from typing import TextIO, TypeAlias, cast

from palpate.errors import InputError
from palpate.holds.form import find_form
from palpate.holds.rows import GatheredRows
from palpate.holds.table import Table

#: Rows of fields, and the number of each one's first line in the file.
NumberedRows: TypeAlias = tuple[list[list[str]], Sequence[int]]

#: Rows converted at a time: enough to hide NumPy's overhead, few enough to stay in the cache
#: (65536 took three times as long per row).
ROWS_AT_A_TIME = 4096
#: Enough to see encoding, notes, header and the first rows.
SAMPLE_BYTES, _SAMPLE_LINES = 65536, 400
#: No line of a table is longer; a file without line ends must not be read into memory whole.
LONGEST_LINE = 65536
_GZIP_MAGIC = b"\x1f\x8b"
_BROKEN = (EOFError, zlib.error, gzip.BadGzipFile)
_MEND = "the gzip data are cut or damaged there; copy the file again"


def read_text(file: BufferedReader, *, name: str) -> Table:
    """Read a table from a text file.

    Commas, semicolons, tabs, bars or spaces; decimal points or commas; UTF-8, UTF-16 or a Western
    code page. Notes before the header and lines that begin with ``#``, ``%`` or ``//`` are passed
    over.

    Raises `InputError` if it isn't text, there is no table in it, or more than a few rows can't be
    used.
    """
    with open_text(file, name=name) as text:
        lines = _without_comments(lines_of(text))
        sample = list(islice(lines, _SAMPLE_LINES))
        form = find_form(sample, name=name)
        gathered = GatheredRows(form.names, decimal_comma=form.decimal_comma)
        body = chain(sample[form.first :], lines)
        for rows, numbers in split_rows(
            body, separator=form.separator, first_number=form.first + 1, name=name
        ):
            gathered.add(rows, numbers=numbers)
        return gathered.table(name)


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


def _without_comments(lines: Iterable[str]) -> Iterator[str]:
    """Yield comments as empty lines, so that lines can be counted."""
    for line in lines:
        comment = line[0] in "#%/" and (line[0] != "/" or line[1:2] == "/")
        yield "\n" if comment else line


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
    rows: Iterator[list[str]]
    if separator is None:
        rows = (line.split() for line in lines)
    else:
        rows = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=strict)
    number, failure = first_number, None
    while failure is None:
        piece, failure = _take(rows)
        if not piece and failure is None:
            return
        *starts, number = accumulate(map(_lines_in, piece), initial=number)
        if piece:
            yield piece, starts
    if isinstance(failure, csv.Error):
        raise InputError(
            f"{name} line {number}: not CSV ({failure}); look for an unclosed quote"
        ) from failure
    raise InputError(f"{name} line {number}: {_MEND}") from failure


def _take(rows: Iterator[list[str]]) -> tuple[list[list[str]], Exception | None]:
    """Return some rows, and what went wrong after them."""
    piece: list[list[str]] = []
    try:
        piece.extend(islice(rows, ROWS_AT_A_TIME))
    except (csv.Error, *_BROKEN) as failure:
        return piece, failure
    return piece, None


def _lines_in(row: list[str]) -> int:
    """Return how many lines of the file a row takes: quoted fields may hold line ends."""
    if "\n" not in (joined := "".join(row)) and "\r" not in joined:
        return 1
    return 1 + sum(max(field.count("\n"), field.count("\r")) for field in row)
