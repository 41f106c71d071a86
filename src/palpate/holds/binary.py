"""Tables in Parquet and Excel workbooks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError, needing
from palpate.holds.form import form_of_rows, score_rows
from palpate.holds.rows import GatheredRows
from palpate.holds.table import Table, usable
from palpate.holds.text import LONGEST_LINE

_SAMPLE_ROWS = 400
#: What a column may have in a Parquet file apart from its cells, bytes.
_PAGE_BYTES = 1_000_000


def pyarrow_for(what: str, *, extra: str = "data") -> Any:
    """Return pyarrow with its Parquet part, for what needs it.

    Raises `MissingExtraError` if it is not installed.
    """
    with needing(what, extra=extra):
        import pyarrow
        import pyarrow.parquet
    return pyarrow


@contextmanager
def open_parquet(file: BinaryIO, *, name: str) -> Iterator[Any]:
    """Open a Parquet file as a `pyarrow.parquet.ParquetFile`.

    Raises `InputError` if it is no whole Parquet file, also where that shows only while it is read;
    `MissingExtraError` if pyarrow is not installed.
    """
    pa = pyarrow_for(f"{name}: Parquet")
    try:
        found = pa.parquet.ParquetFile(file, pre_buffer=False)
        leaves = [found.schema.column(at) for at in range(len(found.schema))]
        texts = [leaf.path for leaf in leaves if leaf.physical_type == "BYTE_ARRAY"]
        _check_sizes(found.metadata, name=name)
        # Each text once: few bytes of a file can repeat a long one without end.
        yield pa.parquet.ParquetFile(file, pre_buffer=False, read_dictionary=texts)
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{name}: not a whole Parquet file ({reason}); copy or export it again"
        ) from error


def _check_sizes(metadata: Any, *, name: str) -> None:
    """Refuse columns whose cells are longer in the mean than any cell may be."""
    for group in range(metadata.num_row_groups):
        for at in range(metadata.num_columns):
            chunk = metadata.row_group(group).column(at)
            if chunk.total_uncompressed_size > _PAGE_BYTES + chunk.num_values * LONGEST_LINE:
                _refuse_text(chunk.path_in_schema, name=name)


def texts_of(cells: Any, column: str, *, name: str, missing: str | None) -> NDArray[Any]:
    """Return the texts of a column that `open_parquet` gave, or of its integers.

    `cells`: an array, not chunked. `missing`: what an empty cell becomes.
    Raises `InputError` if one is longer than a line of a text file may be.
    """
    encoded = cells if hasattr(cells, "dictionary") else cells.dictionary_encode()
    words = encoded.dictionary.to_pylist()
    if any(isinstance(word, str | bytes) and len(word) > LONGEST_LINE for word in words):
        _refuse_text(column, name=name)
    known = np.empty(len(words) + 1, object)
    known[:] = [*words, missing]
    texts: NDArray[Any] = known[encoded.indices.fill_null(len(words)).to_numpy()]
    return texts


def _refuse_text(column: str, *, name: str) -> NoReturn:
    raise InputError(
        f"{name}: column {column} has a text of more than {LONGEST_LINE} characters; shorten it"
    )


def read_parquet_table(file: BinaryIO, *, name: str) -> Table:
    """Read a Parquet file.

    Raises `InputError` if it is no whole Parquet file; `MissingExtraError` if pyarrow is not
    installed.
    """
    with open_parquet(file, name=name) as parquet:
        from pyarrow.types import is_dictionary, is_nested

        flat = [column.name for column in parquet.schema_arrow if not is_nested(column.type)]
        read = parquet.read(columns=flat, use_pandas_metadata=True)
        arrays = {column.name: np.zeros(read.num_rows, object) for column in parquet.schema_arrow}
        for column in read.schema:
            cells = read.column(column.name)
            if is_dictionary(column.type):
                parts = [
                    texts_of(part, column.name, name=name, missing=None) for part in cells.chunks
                ]
                arrays[column.name] = np.concatenate(parts) if parts else np.empty(0, object)
            else:
                arrays[column.name] = cells.to_numpy()
    return table_of_arrays(arrays, name=name)


def table_of_arrays(source: Any, *, name: str) -> Table:
    """Return a table of arrays by name, or of a data frame (anything with columns that index it).

    A data frame's index takes part where it has times in it or a name.

    Raises `InputError` if the columns are not one-dimensional and of equal length, or there are
    none.
    """
    arrays: dict[str, Any] = {}
    if isinstance(source, Mapping):
        arrays = {str(key): value for key, value in source.items()}
    else:
        index = getattr(source, "index", None)
        times = getattr(getattr(index, "dtype", None), "kind", "") in "mM"
        if index is not None and (times or getattr(index, "name", None) is not None):
            arrays[str(index.name or "time")] = index
        arrays |= {str(key): source[key] for key in source.columns}
    columns = {key: _column(value, key, name=name) for key, value in arrays.items()}
    lengths = {key: column.size for key, column in columns.items()}
    if not columns or len(set(lengths.values())) > 1 or not next(iter(lengths.values())):
        raise InputError(f"{name}: columns of equal length are needed, not of {lengths or 'none'}")
    return Table(name=name, columns=columns, place=lambda row: f"row {row + 1}")


def _column(values: Any, key: str, *, name: str) -> NDArray[Any]:
    array = np.asarray(values)
    if array.ndim != 1:
        raise InputError(f"{name}: {key} has shape {array.shape}; give one-dimensional columns")
    if array.dtype.kind in "mM":
        return array
    try:
        numbers = np.array(array, dtype=np.float64)
    except (TypeError, ValueError):
        return array.astype(object)
    numbers[~usable(numbers)] = np.nan
    return numbers


def read_spreadsheet(path: Path) -> Table:
    """Read the first sheet of an .xlsx workbook that has a table in it.

    Raises `InputError` if it is no such workbook, or no sheet has a table; `MissingExtraError` if
    python-calamine is not installed.
    """
    name = str(path)
    with needing(f"{name}: Excel", extra="data"):
        from python_calamine import CalamineError, load_workbook
    try:
        with load_workbook(path) as book:
            for sheet in map(book.get_sheet_by_index, range(len(book.sheet_names))):
                cells = sheet.to_python(skip_empty_area=False)
                rows = [[_text(cell) for cell in row] for row in cells]
                score, width = score_rows(rows[:_SAMPLE_ROWS])
                if not score:
                    continue
                form = form_of_rows(rows[:_SAMPLE_ROWS], width, separator=None)
                gathered = GatheredRows(form.names, decimal_comma=form.decimal_comma, word="row")
                gathered.add(rows[form.first :], numbers=range(form.first + 1, len(rows) + 1))
                return gathered.table(name)
    except CalamineError as error:
        raise InputError(
            f"{name}: not a whole .xlsx workbook; save it again as .xlsx or CSV"
        ) from error
    raise InputError(f"{name}: no sheet with rows of times and readings")


def _text(cell: Any) -> str:
    """Return a cell as a text file would have it."""
    if isinstance(cell, bool):
        return str(cell)
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    return repr(cell) if isinstance(cell, int | float) else str(cell)
