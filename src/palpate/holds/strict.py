"""Strict reader of tables with known columns; errors name the invalid line."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BufferedReader
from itertools import chain
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds.table import LARGEST_NUMBER, Table, is_usable
from palpate.holds.table_files import detect_format, open_parquet, open_table, read_parquet_chunks
from palpate.holds.text import (
    SEPARATORS,
    open_text,
    parse_numbers,
    read_lines,
    split_line,
    split_rows,
)

#: Type of a column: finite numbers, numbers or empty cells (NaN), or text.
Kind: TypeAlias = Literal["number", "number or empty", "text"]
_NO_COLUMNS: Mapping[str, Kind] = {}


def read_table(
    path: str | os.PathLike[str], *, columns: Mapping[str, Kind]
) -> dict[str, NDArray[Any]]:
    """Read the named columns of a table with a header line; other columns are skipped.

    `path`: Parquet or CSV, gzipped or not. CSV may use semicolons or tabs, and then also decimal
        commas.
    Returns float64 for numbers (finite, or NaN if empty) and objects for text, each of shape
    (n_rows,). Raises `InputError` if the file can't be read, a column is missing, or a cell is
    invalid; `MissingExtraError` if the file is Parquet and pyarrow is not installed.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "loads.csv"
    >>> _ = path.write_text("step,load_n\\n1,0.5\\n2,heavy\\n")
    >>> read_table(path, columns={"step": "number"})["step"].tolist()
    [1.0, 2.0]
    >>> try:
    ...     read_table(path, columns={"load_n": "number"})
    ... except InputError as error:
    ...     print(str(error).replace(str(path), "loads.csv"))
    loads.csv line 3: load_n is 'heavy', not a finite number up to 1e+150; fix or remove the line
    """
    chunks = list(read_chunks(path, columns=columns))
    return {name: np.concatenate([chunk.columns[name] for chunk in chunks]) for name in columns}


def read_chunks(
    path: str | os.PathLike[str],
    *,
    columns: Mapping[str, Kind],
    optional: Mapping[str, Kind] = _NO_COLUMNS,
    progress: Callable[[float], None] | None = None,
) -> Generator[Table, None, None]:
    """Read a table as `read_table` does, a few thousand rows at a time.

    `path`: read once and in order (except Parquet), so it may be a pipe.
    `optional`: columns that may be missing.
    `progress`: called periodically with the fraction of the file read so far, 0 to 1.
    Yields at least one table; each has at least one row.
    """
    path = Path(path)
    name, wanted, found = str(path), _Wanted(columns=columns, optional=optional), False
    with open_table(path) as file:
        form = detect_format(file, name=name)
        if form == "spreadsheet":
            raise InputError(f"{name}: an Excel workbook; save it as CSV")
        # The file extension decides only if the first bytes match no format.
        packed = form == "parquet" or path.suffix.lower() in (".parquet", ".pq")
        status = os.fstat(file.fileno())
        for chunk in (_read_parquet_chunks if packed else _read_text_chunks)(
            file, wanted, name=name
        ):
            if chunk.rows:
                found = True
                yield chunk
            # The length of a pipe is unknown.
            if progress is not None and stat.S_ISREG(status.st_mode):
                progress(min(1.0, file.tell() / status.st_size))
    if not found:
        raise InputError(f"{name}: no rows below the header; add rows of data")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wanted:
    """The columns to read."""

    columns: Mapping[str, Kind]
    optional: Mapping[str, Kind]

    def select(self, names: Sequence[str], *, where: str) -> dict[str, Kind]:
        """Return the wanted columns among the available `names`, in any order."""
        need = f"required: {','.join(self.columns)}"
        if self.optional:
            need += f"; optional: {','.join(self.optional)}"
        found = ", ".join(names)[:80]
        if not all(name.isprintable() for name in names):
            raise InputError(
                f"{where}: the header contains unprintable characters; save the file as UTF-8 CSV "
                f"({need})"
            )
        if missing := [name for name in self.columns if name not in names]:
            raise InputError(f"{where}: no column {', '.join(missing)} (found: {found}); {need}")
        kinds = {n: k for n, k in {**self.columns, **self.optional}.items() if n in names}
        for name in kinds:
            if list(names).count(name) > 1:
                raise InputError(f"{where}: column {name} occurs twice ({found}); {need}")
        return kinds


def _read_text_chunks(file: BufferedReader, wanted: _Wanted, *, name: str) -> Iterator[Table]:
    with open_text(file, name=name) as text:
        text_lines = read_lines(text)
        header = next(text_lines, "")
        # The default is a comma if no separator yields the columns.
        fields = {mark: [f.strip() for f in split_line(header, mark)] for mark in SEPARATORS}
        separator = next((m for m, names in fields.items() if {*wanted.columns} <= {*names}), ",")
        names = fields[separator]
        kinds = wanted.select(names, where=f"{name} line 1")
        # Decimal mark, None until a number contains one. A later number with the other mark is
        # refused, because 1,234 next to 0.5 would be misread by a factor of 1000.
        mark = "." if separator == "," else None
        for rows, places in split_rows(
            text_lines, separator=separator, first_number=2, name=name, strict=True
        ):
            full, lines, odd = rows, places, None
            if set(map(len, rows)) != {len(names)}:
                # Blank lines have no fields.
                filled = [i for i, row in enumerate(rows) if any(f.strip() for f in row)]
                odd = next((i for i in filled if len(rows[i]) != len(names)), None)
                complete = [i for i, row in enumerate(rows[:odd]) if len(row) == len(names)]
                full, lines = [rows[i] for i in complete], [places[i] for i in complete]
            parts = zip(*full, strict=True)
            cells = {n: part for n, part in zip(names, parts, strict=False) if n in kinds}
            if mark is None:
                signs = "".join(chain(*(cells[n] for n in cells if kinds[n] != "text")))
                mark = next((sign for sign in signs if sign in ",."), None)
            if cells:
                numbers = {
                    column: _strict_numbers(cells[column], mark=mark)
                    for column, kind in kinds.items()
                    if kind != "text"
                }
                yield _check_cells(
                    cells, numbers, kinds, table_name=name, row_word="line", row_numbers=lines
                )
            if odd is not None:
                raise InputError(
                    f"{name} line {places[odd]}: {len(rows[odd])} fields, but the header has "
                    f"{len(names)} ({','.join(names)}); fix or remove the line"
                )


def _strict_numbers(fields: Sequence[str], *, mark: str | None) -> FloatArray:
    numbers = parse_numbers(fields, comma=mark == ",")
    if mark == ",":
        numbers[["." in field for field in fields]] = np.nan
    return numbers


def _read_parquet_chunks(file: BufferedReader, wanted: _Wanted, *, name: str) -> Iterator[Table]:
    with open_parquet(file, name=name) as parquet:
        import pyarrow.types as types

        schema = parquet.schema_arrow
        kinds = wanted.select(schema.names, where=name)
        for column, kind in kinds.items():
            found = schema.field(column).type
            plain = found.value_type if types.is_dictionary(found) else found
            text = types.is_string(plain) or types.is_large_string(plain)
            fits = text if kind == "text" else types.is_floating(plain)
            if not fits and not types.is_integer(plain):
                must = "text" if kind == "text" else "numbers"
                raise InputError(f"{name}: column {column} is {plain}; it must be {must}")
        for chunk in read_parquet_chunks(parquet, list(kinds)):
            cells, numbers = dict[str, Sequence[Any]](), dict[str, FloatArray]()
            for column, kind in kinds.items():
                cells[column] = chunk.columns[column].tolist()
                if kind == "text":
                    cells[column] = ["" if cell is None else str(cell) for cell in cells[column]]
                else:
                    numbers[column] = chunk.columns[column].astype(np.float64)
                    numbers[column][~is_usable(numbers[column])] = np.nan
            yield _check_cells(
                cells, numbers, kinds, table_name=name, row_word="row", row_numbers=chunk.numbers
            )


def _check_cells(
    cells: Mapping[str, Sequence[Any]],
    numbers: Mapping[str, FloatArray],
    kinds: Mapping[str, Kind],
    *,
    table_name: str,
    row_word: str,
    row_numbers: Sequence[int],
) -> Table:
    """Return the cells as a table; raise `InputError` for the first invalid number."""
    faults: list[tuple[int, str]] = []
    for column, values in numbers.items():
        wrong = np.flatnonzero(np.isnan(values)).tolist()
        if kinds[column] == "number or empty":
            wrong = [row for row in wrong if str(cells[column][row] or "").strip()]
        faults += [(row, column) for row in wrong[:1]]
    if faults:
        row, column = min(faults, key=lambda fault: fault[0])
        cell, remedy = cells[column][row], "fill it in or remove the row"
        found = "missing" if cell is None else f"{cell}"
        if isinstance(cell, str):
            found, remedy = f"{cell[:40]!a}", "fix or remove the line"
        raise InputError(
            f"{table_name} {row_word} {row_numbers[row]}: {column} is {found}, not a finite "
            f"number up to {LARGEST_NUMBER:g}; {remedy}"
        )
    texts = {n: np.array(cells[n], dtype=object) for n in kinds if n not in numbers}
    return Table(name=table_name, columns={**texts, **numbers}, numbers=row_numbers, word=row_word)
