"""Tables in files of any form, recognised by their first bytes, and in arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date, datetime, time, timedelta
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any, BinaryIO, Literal, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError, require_extra
from palpate.holds import table
from palpate.holds.table import LONGEST_LINE, Table, is_usable
from palpate.holds.text import SAMPLE_BYTES, SAMPLE_ROWS, gather_rows, layout_of, read_text

FileForm: TypeAlias = Literal["text", "parquet", "spreadsheet"]

_FORMS: dict[bytes, FileForm] = {b"PAR1": "parquet", b"PK\x03\x04": "spreadsheet"}
_OLD_EXCEL_MAGIC = b"\xd0\xcf\x11\xe0"
MCAP_MAGIC = b"\x89MCA"
#: What a column may have in a Parquet file apart from its cells, bytes.
_PAGE_BYTES = 1_000_000


def open_table(path: Path) -> BufferedReader:
    """Open a file for reading, with lookahead.

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
        if form == "spreadsheet":
            return _read_spreadsheet(path)
        with open_parquet(file, name=name) as parquet:
            from pyarrow.types import is_nested

            columns = parquet.schema_arrow
            pieces = list(
                parquet_pieces(parquet, [c.name for c in columns if not is_nested(c.type)])
            )
    # Lists and the like are no readings, but they have a name.
    rows = sum(piece.rows for piece in pieces)
    arrays = dict.fromkeys(columns.names, np.zeros(rows, object))
    for column in pieces[0].columns if pieces else ():
        arrays[column] = np.concatenate([piece.columns[column] for piece in pieces])
    return table_of_arrays(arrays, name=name)


def pyarrow_for(what: str) -> Any:
    """Return pyarrow with its Parquet part, for what needs it.

    Raises `MissingExtraError` if it is not installed.
    """
    with require_extra(what, extra="data"):
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
        for group in map(found.metadata.row_group, range(found.metadata.num_row_groups)):
            for chunk in map(group.column, range(group.num_columns)):
                if chunk.total_uncompressed_size > _PAGE_BYTES + chunk.num_values * LONGEST_LINE:
                    _refuse_text(chunk.path_in_schema)
        # Each text once: few bytes of a file can repeat a long one without end.
        yield pa.parquet.ParquetFile(file, pre_buffer=False, read_dictionary=texts)
    except InputError as error:
        raise InputError(f"{name}: {str(error).removeprefix(f'{name}: ')}") from error
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{name}: not a whole Parquet file ({reason}); copy or export it again"
        ) from error


def parquet_pieces(parquet: Any, columns: Sequence[str]) -> Iterator[Table]:
    """Yield columns of what `open_parquet` gave, some thousand rows at a time.

    Numbers that are missing are None.

    Raises `InputError` if a text is longer than a line of a text file may be.
    """
    start = 1
    for batch in parquet.iter_batches(batch_size=table.ROWS_AT_A_TIME, columns=list(columns)):
        found = {column: _cells(batch.column(column), column) for column in columns}
        following = start + batch.num_rows
        yield Table(name="", columns=found, numbers=range(start, following))
        start = following


def _cells(cells: Any, column: str) -> NDArray[Any]:
    from pyarrow.types import is_dictionary, is_temporal

    if is_dictionary(cells.type):
        words = cells.dictionary.to_pylist()
        if any(isinstance(word, str | bytes) and len(word) > LONGEST_LINE for word in words):
            _refuse_text(column)
    elif is_temporal(cells.type) or not cells.null_count:
        return np.asarray(cells.to_numpy(zero_copy_only=False))
    found = np.empty(len(cells), object)
    found[:] = cells.to_pylist()
    return found


def _refuse_text(column: str) -> NoReturn:
    raise InputError(
        f"column {column} has a text of more than {LONGEST_LINE} characters; shorten it"
    )


def _read_spreadsheet(path: Path) -> Table:
    """Read the first sheet of an .xlsx workbook that has a table in it.

    Raises `InputError` if it is no such workbook, or no sheet has a table; `MissingExtraError` if
    python-calamine is not installed.
    """
    name = str(path)
    with require_extra(f"{name}: Excel", extra="data"):
        from python_calamine import CalamineError, load_workbook
    try:
        with load_workbook(path) as book:
            for sheet in map(book.get_sheet_by_index, range(len(book.sheet_names))):
                cells = sheet.to_python(skip_empty_area=False)
                rows = [[_text(cell) for cell in row] for row in cells]
                if layout := layout_of(rows[:SAMPLE_ROWS]):
                    below = rows[layout.first :], range(layout.first + 1, len(rows) + 1)
                    return gather_rows([below], layout, name=name, word="row")
    except CalamineError as error:
        raise InputError(
            f"{name}: not a whole .xlsx workbook; save it again as .xlsx or CSV"
        ) from error
    raise InputError(f"{name}: no sheet with rows of times and readings")


def _text(cell: Any) -> str:
    """Return a cell as a text file would have it; a workbook stores no integers."""
    if isinstance(cell, float) and not isinstance(cell, bool):
        return repr(int(cell)) if cell.is_integer() else repr(cell)
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    return repr(cell.total_seconds()) if isinstance(cell, timedelta) else str(cell)


def table_of_arrays(source: Any, *, name: str) -> Table:
    """Return a table of arrays by name, or of a DataFrame (any object with columns).

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
    rows = next(iter(lengths.values()))
    return Table(name=name, columns=columns, numbers=range(1, rows + 1))


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
    numbers[~is_usable(numbers)] = np.nan
    return numbers
