"""Opening a table's file, and the reader that it needs, by its first bytes."""

from __future__ import annotations

from io import BufferedReader, FileIO
from pathlib import Path
from typing import Literal, TypeAlias

from palpate.errors import InputError
from palpate.holds.table import Table
from palpate.holds.text import SAMPLE_BYTES, read_text

FileForm: TypeAlias = Literal["text", "parquet", "spreadsheet"]

_FORMS: dict[bytes, FileForm] = {b"PAR1": "parquet", b"PK\x03\x04": "spreadsheet"}
_OLD_EXCEL_MAGIC = b"\xd0\xcf\x11\xe0"
MCAP_MAGIC = b"\x89MCA"


def open_table(path: Path) -> BufferedReader:
    """Open a file for reading, with room to look ahead.

    Raises `InputError` if there is no such file, or it can't be read.
    """
    wanted = "name a table's file (CSV or other text, Excel or Parquet)"
    if path.is_dir():
        raise InputError(f"{path}: a folder; {wanted}")
    try:
        return BufferedReader(FileIO(path), SAMPLE_BYTES)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; {wanted}") from error
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; {wanted}") from error


def form_of(file: BufferedReader, *, name: str) -> FileForm:
    """Return the form of a file's table; nothing is read from the file.

    Raises `InputError` if the file is empty, or of a form that holds no table.
    """
    start = file.peek(4)[:4]
    if not start:
        raise InputError(f"{name}: the file is empty; it needs a header and rows")
    if start == _OLD_EXCEL_MAGIC:
        raise InputError(f"{name}: an old Excel file; save it as .xlsx or CSV")
    if start == MCAP_MAGIC:
        raise InputError(
            f"{name}: a recording of palpate's own; `palpate export {name} --holds` cuts its "
            "holds out"
        )
    return _FORMS.get(start, "text")


def read_table_file(path: Path) -> Table:
    """Read a table from CSV and other text, gzip, .xlsx or Parquet.

    Raises `InputError` if there is no such file, or no table in it; `MissingExtraError` if its form
    needs an extra that isn't installed.
    """
    name = str(path)
    with open_table(path) as file:
        form = form_of(file, name=name)
        if form == "text":
            return read_text(file, name=name)
        if form == "parquet":
            from palpate.holds.binary import read_parquet_table

            return read_parquet_table(file, name=name)
    from palpate.holds.binary import read_spreadsheet

    return read_spreadsheet(path)
