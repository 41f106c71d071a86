"""Read tables from arrays and files; the first bytes of a file determine its format."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import date, time, timedelta
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError, require_extra
from palpate.holds import table
from palpate.holds.cells import CellUnits
from palpate.holds.columns import find_clocks
from palpate.holds.decimals import NumberFormat, is_missing
from palpate.holds.formats import START_BYTES, FileFormat, name_format
from palpate.holds.moments import is_moment
from palpate.holds.table import LARGEST_NUMBER, LONGEST_LINE, OPEN_NUMBER, Table
from palpate.holds.text import SAMPLE_BYTES, SAMPLE_ROWS, detect_layout, gather_rows, read_text

#: Overhead allowed for a column of a Parquet file in addition to its cells, bytes.
_PAGE_BYTES = 1_000_000
#: A column of a sheet with fewer cells than this fraction of the fullest column holds notes.
_NOTE_FRACTION = 0.05

#: A sheet with fewer rows than this fraction of the longest is a summary.
_SUMMARY_FRACTION = 0.1


def open_table(path: Path) -> BufferedReader:
    """Open a file for reading, with lookahead.

    Raises `InputError` if the file doesn't exist or can't be read.
    """
    remedy = "give a table file (CSV or other text, Excel or Parquet)"
    if path.is_dir():
        raise InputError(f"{path}: a folder; {remedy}")
    try:
        return BufferedReader(FileIO(path), SAMPLE_BYTES)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; {remedy}") from error
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; {remedy}") from error


def detect_format(file: BufferedReader, *, name: str) -> FileFormat:
    """Return the format of a file without consuming any bytes.

    Raises `InputError` if the file is empty, or of an unsupported format.
    """
    return name_format(file.peek(START_BYTES)[:START_BYTES], name=name)


def read_table_file(
    path: Path, *, sheet: str | None = None, decimal: str | None = None, without_clock: bool = False
) -> Table:
    """Read a table from CSV or other text, gzip, .xlsx or Parquet.

    `sheet`: name of a workbook's sheet; by default the first with a table of times and readings.
    `decimal`, `without_clock`: as for `read_text`.

    Raises `InputError` if the file doesn't exist or contains no table; `MissingExtraError` if the
    format needs an extra that isn't installed.
    """
    name = str(path)
    with open_table(path) as file:
        form = detect_format(file, name=name)
        if sheet is not None and form != "spreadsheet":
            raise InputError(f"{name}: --sheet {sheet}: only a workbook has sheets")
        if form == "text":
            return read_text(file, name=name, decimal=decimal, without_clock=without_clock)
        if form == "spreadsheet":
            return _read_spreadsheet(path, sheet, without_clock=without_clock)
        with open_parquet(file, name=name) as parquet:
            from pyarrow.types import is_nested

            columns = parquet.schema_arrow
            chunks = list(
                read_parquet_chunks(parquet, [c.name for c in columns if not is_nested(c.type)])
            )
    # Nested columns contain no readings, but error messages list their names.
    rows = sum(chunk.rows for chunk in chunks)
    arrays = dict.fromkeys(columns.names, np.zeros(rows, object))
    for column in chunks[0].columns if chunks else ():
        arrays[column] = np.concatenate([chunk.columns[column] for chunk in chunks])
    return table_of_arrays(arrays, name=name)


def import_pyarrow(feature: str) -> Any:
    """Import pyarrow with its Parquet module and return it.

    `feature`: named in the error.
    Raises `MissingExtraError` if pyarrow is not installed.
    """
    with require_extra(feature, extra="data"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow


@contextmanager
def open_parquet(file: BinaryIO, *, name: str) -> Iterator[Any]:
    """Open a Parquet file as a `pyarrow.parquet.ParquetFile`.

    Raises `InputError` if the file is damaged or not a Parquet file, on opening or while reading;
    `MissingExtraError` if pyarrow is not installed.
    """
    pa = import_pyarrow(f"{name}: Parquet")
    try:
        found = pa.parquet.ParquetFile(file, pre_buffer=False)
        leaves = [found.schema.column(at) for at in range(len(found.schema))]
        texts = [leaf.path for leaf in leaves if leaf.physical_type == "BYTE_ARRAY"]
        for group in map(found.metadata.row_group, range(found.metadata.num_row_groups)):
            for chunk in map(group.column, range(group.num_columns)):
                if chunk.total_uncompressed_size > _PAGE_BYTES + chunk.num_values * LONGEST_LINE:
                    _refuse_long_text(chunk.path_in_schema)
        # Dictionaries store each text once; a few bytes of a file can repeat a long text endlessly.
        yield pa.parquet.ParquetFile(file, pre_buffer=False, read_dictionary=texts)
    except InputError as error:
        raise InputError(f"{name}: {str(error).removeprefix(f'{name}: ')}") from error
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{name}: not a complete Parquet file ({reason}); copy or export it again"
        ) from error


def read_parquet_chunks(parquet: Any, columns: Sequence[str]) -> Iterator[Table]:
    """Yield columns of a `ParquetFile` from `open_parquet`, a few thousand rows at a time.

    Missing numbers are None.

    Raises `InputError` if a text is longer than `LONGEST_LINE`.
    """
    start = 1
    for batch in parquet.iter_batches(batch_size=table.ROWS_AT_A_TIME, columns=list(columns)):
        found = {column: _read_cells(batch.column(column), column) for column in columns}
        following = start + batch.num_rows
        yield Table(name="", columns=found, numbers=range(start, following))
        start = following


def _read_cells(cells: Any, column: str) -> NDArray[Any]:
    from pyarrow.types import is_dictionary, is_temporal

    if is_dictionary(cells.type):
        words = cells.dictionary.to_pylist()
        if any(isinstance(word, str | bytes) and len(word) > LONGEST_LINE for word in words):
            _refuse_long_text(column)
    elif is_temporal(cells.type) or not cells.null_count:
        return np.asarray(cells.to_numpy(zero_copy_only=False))
    found = np.empty(len(cells), object)
    found[:] = cells.to_pylist()
    return found


def _refuse_long_text(column: str) -> NoReturn:
    raise InputError(
        f"column {column} has a text of more than {LONGEST_LINE} characters; shorten it"
    )


def _read_spreadsheet(path: Path, wanted: str | None, *, without_clock: bool) -> Table:
    """Read the wanted sheet, or the first with times and readings.

    Raises `InputError` if the file is not an .xlsx workbook, or no sheet has a table;
    `MissingExtraError` if python-calamine is not installed.
    """
    name = str(path)
    with require_extra(f"{name}: Excel", extra="data"):
        from python_calamine import CalamineError, load_workbook
    try:
        with load_workbook(path) as book:
            names = list(book.sheet_names)
            if wanted is not None and wanted not in names:
                raise InputError(f"{name}: no sheet {wanted!a} (available: {', '.join(names)})")
            tables: dict[str, Table] = {}
            for title in names if wanted is None else [wanted]:
                cells = book.get_sheet_by_name(title).to_python(skip_empty_area=False)
                found = _read_sheet(cells, name=f"{name} sheet {title}", narrow=without_clock)
                if found is not None:
                    tables[title] = found
    except CalamineError as error:
        raise InputError(
            f"{name}: not a complete .xlsx workbook; save it again as .xlsx or CSV"
        ) from error
    if not tables:
        raise InputError(
            f"{name}: no sheet with rows of times and readings; add a sheet with a table"
        )
    longest = max(one.rows for one in tables.values())
    timed = [
        title
        for title, one in tables.items()
        # A sheet of results has a row for each test.
        if _has_clock(one) and one.rows >= _SUMMARY_FRACTION * longest
    ]
    chosen = (timed or [*tables])[0]
    if len(names) == 1 or wanted is not None:
        return replace(tables[chosen], name=name)
    others = [title for title in timed if title != chosen]
    remark = f"sheet {chosen!a} was read"
    if others:
        remark += f", and not {', '.join(map(ascii, others))}; --sheet NAME reads another"
    found = tables[chosen]
    return replace(found, name=name, omissions=[remark, *found.omissions])


def list_sheets(path: Path) -> list[str]:
    """Return the names of a workbook's sheets; none of another file."""
    if path.suffix.lower() not in (".xlsx", ".xlsm"):
        return []
    with require_extra(f"{path}: Excel", extra="data"):
        from python_calamine import load_workbook
    with load_workbook(path) as book:
        return list(book.sheet_names)


def _has_clock(found: Table) -> bool:
    dates = any(
        column.dtype == object and is_moment(str(column[0])) for column in found.columns.values()
    )
    return bool(find_clocks([*found.columns])) or dates or "1" in found.columns


def _read_sheet(cells: list[list[Any]], *, name: str, narrow: bool) -> Table | None:
    """Return the table of a sheet, or None if there is none."""
    rows = [[_cell_text(cell) for cell in row] for row in cells]
    rows = _drop_notes(rows)
    layout = detect_layout(rows[:SAMPLE_ROWS], narrowest=1 if narrow else 2)
    if layout is None:
        return None
    below = rows[layout.first :], range(layout.first + 1, len(rows) + 1)
    # Cells hold numbers, so a mark in a text doesn't change them.
    return gather_rows([below], layout, name=name, word="row")


def _drop_notes(rows: list[list[str]]) -> list[list[str]]:
    """Return rows without the columns at the right that have few cells, such as notes."""
    if not rows:
        return rows
    counts = [sum(bool(text.strip()) for text in column) for column in zip(*rows, strict=True)]
    width = len(counts)
    while width and counts[width - 1] <= _NOTE_FRACTION * max(counts):
        width -= 1
    return [row[:width] for row in rows]


def _cell_text(cell: Any) -> str:
    """Return a cell as text; integers are stored as floats in a workbook."""
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() else repr(cell)
    if isinstance(cell, date | time):
        return cell.isoformat()
    return repr(cell.total_seconds()) if isinstance(cell, timedelta) else str(cell)


def table_of_arrays(source: Any, *, name: str) -> Table:
    """Return a table from a mapping of arrays or a DataFrame (any object with columns).

    The index of a DataFrame becomes a column if it contains times or has a name.

    Raises `InputError` if there are no columns, or they are not one-dimensional and of equal
    length.
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
    columns = dict(_to_column(value, key, name=name) for key, value in arrays.items())
    lengths = {key: column.size for key, column in columns.items()}
    if not columns or len(set(lengths.values())) > 1 or not next(iter(lengths.values())):
        raise InputError(
            f"{name}: the columns must have equal, nonzero lengths; found {lengths or 'no columns'}"
        )
    rows = next(iter(lengths.values()))
    return Table(name=name, columns=columns, numbers=range(1, rows + 1))


def _to_column(values: Any, key: str, *, name: str) -> tuple[str, NDArray[Any]]:
    """Return the name and cells of a column, with the unit of its cells in the name."""
    array = np.asarray(values)
    if array.ndim != 1:
        raise InputError(f"{name}: {key} has shape {array.shape}; columns must be one-dimensional")
    if array.dtype.kind in "mM":
        return key, array
    try:
        numbers = np.array(array, dtype=np.float64)
    except (TypeError, ValueError):
        texts = [str(cell) for cell in array.tolist()]
        numbers, units = NumberFormat().parse(texts), CellUnits(column=key)
        filled = {row: text for row, text in enumerate(texts) if not is_missing(text)}
        others = {row: text for row, text in filled.items() if np.isnan(numbers[row])}
        with_unit = units.split(others, parse=NumberFormat().parse)
        is_partly_text = with_unit.keys() != others.keys() or 2 * len(filled) < len(texts)
        if not with_unit or is_partly_text:
            return key, array.astype(object)
        numbers[[*with_unit]] = [*with_unit.values()]
        return units.convert(numbers, place=lambda row: f"row {row + 1}", name=name), numbers
    numbers[numbers >= OPEN_NUMBER] = np.inf
    numbers[~((np.abs(numbers) <= LARGEST_NUMBER) | (numbers == np.inf))] = np.nan
    return key, numbers
