"""Tables in Excel workbooks."""

from __future__ import annotations

from datetime import date, datetime, time, timedelta
from itertools import islice
from pathlib import Path
from typing import Any

from palpate.errors import InputError, needing
from palpate.tables.form import form_of_rows, score_rows
from palpate.tables.rows import GatheredRows
from palpate.tables.table import Table

_SAMPLE_ROWS = 400


def read_spreadsheet(path: Path) -> Table:
    """Read the first sheet of an .xlsx workbook that has a table in it.

    Raises
    ------
    InputError
        If it is no such workbook, or no sheet has a table.
    MissingExtraError
        If openpyxl is not installed.
    """
    name = str(path)
    with needing(f"{name}: Excel", extra="data"):
        from openpyxl import load_workbook
    try:
        book = load_workbook(path, read_only=True, data_only=True)
    # openpyxl lets through whatever zip, XML and its own readers raise on a damaged file.
    except Exception as error:
        raise InputError(
            f"{name}: not a whole .xlsx workbook; save it again as .xlsx or CSV"
        ) from error
    try:
        for sheet in book.worksheets:
            if (table := _sheet_table(sheet, name=name)) is not None:
                return table
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{name}: a damaged workbook; save it again as .xlsx or CSV") from error
    finally:
        book.close()
    raise InputError(f"{name}: no sheet with rows of times and readings")


def _sheet_table(sheet: Any, *, name: str) -> Table | None:
    rows = ([_text(cell) for cell in row] for row in sheet.iter_rows(values_only=True))
    sample = list(islice(rows, _SAMPLE_ROWS))
    score, width = score_rows(sample)
    if not score:
        return None
    form = form_of_rows(sample, width, separator=None)
    gathered = GatheredRows(form.names, decimal_comma=form.decimal_comma, word="row")
    body = [*sample[form.first :], *rows]
    gathered.add(body, numbers=range(form.first + 1, form.first + 1 + len(body)))
    return gathered.table(name)


def _text(cell: Any) -> str:
    """Return a cell as a text file would have it."""
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return str(cell)
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    return repr(cell) if isinstance(cell, int | float) else str(cell)
