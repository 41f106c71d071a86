"""Which reader a recording's file needs, by its first bytes."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import InputError
from palpate.readings.table import Table

PARQUET_MAGIC = b"PAR1"
_ZIP_MAGIC = b"PK\x03\x04"
_OLD_EXCEL_MAGIC = b"\xd0\xcf\x11\xe0"


def read_table_file(path: Path) -> Table:
    """Read a table from CSV and other text, gzip, .xlsx or Parquet.

    Raises
    ------
    InputError
        If there is no such file, or no table in it.
    MissingExtraError
        If its form needs an extra that isn't installed.
    """
    try:
        with path.open("rb") as file:
            start = file.read(4)
    except FileNotFoundError as error:
        raise InputError(
            f"{path}: no such file; name a recording (CSV, TSV, Excel, Parquet or .mcap)"
        ) from error
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; name a recording's file") from error
    if not start:
        raise InputError(f"{path}: the file is empty")
    if start == PARQUET_MAGIC:
        from palpate.readings.parquet import read_parquet_table

        return read_parquet_table(path)
    if start == _ZIP_MAGIC:
        from palpate.readings.spreadsheet import read_spreadsheet

        return read_spreadsheet(path)
    if start == _OLD_EXCEL_MAGIC:
        raise InputError(f"{path}: an old Excel file; save it as .xlsx or CSV")
    from palpate.readings.text import read_text

    return read_text(path)
