"""Tables in text files, plain or gzipped, with notes and comments around them."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Iterator
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import BinaryIO, cast

from palpate.errors import InputError
from palpate.readings.form import Form, find_form
from palpate.readings.rows import GatheredRows
from palpate.readings.table import Table

GZIP_MAGIC = b"\x1f\x8b"
#: Enough to see notes, header and the first rows.
_SAMPLE_BYTES, _SAMPLE_LINES = 65536, 400
#: No line of a table is longer; a file without line ends must not be read as one.
_LONGEST_LINE = 65536
_ROWS_AT_A_TIME = 4096
_BROKEN = (EOFError, zlib.error, gzip.BadGzipFile)


def read_text(path: Path) -> Table:
    """Read a table from a text file.

    Commas, semicolons, tabs, bars or spaces; decimal points or commas; UTF-8, UTF-16 or a Western
    code page. Notes before the header and lines that begin with ``#``, ``%`` or ``//`` are passed
    over.

    Raises
    ------
    InputError
        If it isn't text, there is no table in it, or more than a few rows can't be used.
    """
    name = str(path)
    try:
        with _open(path) as binary:
            encoding = _encoding(binary.read(_SAMPLE_BYTES), name=name)
        with TextIOWrapper(_open(path), encoding=encoding, errors="replace") as text:
            form = find_form(list(islice(_lines(text), _SAMPLE_LINES)), name=name)
        with TextIOWrapper(_open(path), encoding=encoding, errors="replace") as text:
            return _gather(_lines(text), form, name=name)
    except _BROKEN as error:
        raise InputError(f"{name}: the gzip data are cut or damaged; copy it again") from error


def _open(path: Path) -> BinaryIO:
    with path.open("rb") as file:
        packed = file.read(2) == GZIP_MAGIC
    return cast(BinaryIO, gzip.open(path) if packed else path.open("rb"))


def _encoding(start: bytes, *, name: str) -> str:
    """Return the encoding that the first bytes fit."""
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    if b"\0" in start:
        raise InputError(
            f"{name}: not a text file; give CSV, TSV, Excel (.xlsx), Parquet or an .mcap recording"
        )
    try:
        # A letter may be cut in two at the end of the sample.
        start[:-4].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _lines(text: TextIOWrapper) -> Iterator[str]:
    """Yield lines, comments as empty ones, so that lines can be counted."""
    while line := text.readline(_LONGEST_LINE):
        comment = line[0] in "#%/" and (line[0] != "/" or line[1:2] == "/")
        yield "\n" if comment else line


def _gather(lines: Iterator[str], form: Form, *, name: str) -> Table:
    gathered = GatheredRows(form.names, decimal_comma=form.decimal_comma)
    body = islice(lines, form.first, None)
    rows: Iterator[list[str]]
    if form.separator is None:
        rows = (line.split() for line in body)
    else:
        rows = csv.reader(body, delimiter=form.separator, skipinitialspace=True)
    number = form.first + 1
    while True:
        try:
            piece = list(islice(rows, _ROWS_AT_A_TIME))
        except csv.Error as error:
            raise InputError(f"{name} after line {number}: not a table ({error})") from error
        if not piece:
            return gathered.table(name)
        gathered.add(piece, first_number=number)
        number += len(piece)
