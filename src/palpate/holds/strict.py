"""Tables of known columns, whatever their form: used as they are, or refused with the line."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.form import SEPARATORS, split_fields
from palpate.holds.table import LARGEST, Table, usable
from palpate.holds.table_files import form_of, open_table
from palpate.holds.text import ROWS_AT_A_TIME, lines_of, open_text, split_rows

#: What a column holds: a finite number, one that may be left empty (NaN), or text.
Kind: TypeAlias = Literal["number", "number or empty", "text"]
_NO_COLUMNS: Mapping[str, Kind] = {}


def read_table(
    path: str | os.PathLike[str], *, columns: Mapping[str, Kind]
) -> dict[str, NDArray[Any]]:
    """Read the named columns of a table with a header line; other columns are skipped.

    `path`: CSV, with semicolons or tabs as well and then with decimal commas too, gzipped or not,
        or Parquet.
    Returns float64 for numbers (finite, or NaN where left empty), objects for text, each of shape
    (n_rows,). Raises `InputError` if the file can't be read, a column is missing, or a field is not
    what it should be; `MissingExtraError` if the file is Parquet and pyarrow is not installed.

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
    pieces = list(read_pieces(path, columns=columns))
    return {name: np.concatenate([piece.columns[name] for piece in pieces]) for name in columns}


def read_pieces(
    path: str | os.PathLike[str],
    *,
    columns: Mapping[str, Kind],
    optional: Mapping[str, Kind] = _NO_COLUMNS,
    progress: Callable[[float], None] | None = None,
) -> Iterator[Table]:
    """Read a table as `read_table` does, some thousand rows at a time.

    `path`: read once and in order (unless it is Parquet), so that it may be a pipe.
    `optional`: columns that need not be there.
    `progress`: called now and then with the share of the file read so far, 0 to 1.
    Yields at least one table, of at least one row each.
    """
    path = Path(path)
    name, wanted = str(path), _Wanted(columns=columns, optional=optional)
    with open_table(path) as file:
        form, found = form_of(file, name=name), False
        if form == "spreadsheet":
            raise InputError(f"{name}: an Excel workbook; save it as CSV")
        # The ending decides only where the first bytes are no format's.
        packed = form == "parquet" or path.suffix.lower() in (".parquet", ".pq")
        read = _parquet_pieces if packed else _text_pieces
        share = _share_read(file)
        for piece in read(file, wanted, name=name):
            if piece.rows:
                found = True
                yield piece
            if progress is not None and share is not None:
                progress(share())
    if not found:
        raise InputError(f"{name}: no rows below the header; add them")


def _share_read(file: BufferedReader) -> Callable[[], float] | None:
    """Return a function for the share of a file that is read; a pipe has no length."""
    status = os.fstat(file.fileno())
    if not stat.S_ISREG(status.st_mode) or status.st_size == 0:
        return None
    return lambda: min(1.0, file.tell() / status.st_size)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wanted:
    """The columns that are read."""

    columns: Mapping[str, Kind]
    optional: Mapping[str, Kind]

    def of(self, names: Sequence[str], *, where: str) -> dict[str, Kind]:
        """Return the columns to read of those that there are: any order, any others."""
        need = f"it needs {','.join(self.columns)}"
        if self.optional:
            need += f" and may have {','.join(self.optional)}"
        found = ", ".join(names)[:80]
        if not all(name.isprintable() for name in names):
            raise InputError(f"{where}: not a line of text; {need}; save it as UTF-8 CSV")
        if missing := [name for name in self.columns if name not in names]:
            raise InputError(f"{where}: no column {', '.join(missing)} (it has: {found}); {need}")
        kinds = {n: k for n, k in {**self.columns, **self.optional}.items() if n in names}
        for name in kinds:
            if list(names).count(name) > 1:
                raise InputError(f"{where}: column {name} occurs twice ({found}); {need}")
        return kinds

    def separator(self, header: str) -> str | None:
        """Return the separator that finds the columns; a comma where none does."""
        for separator in SEPARATORS:
            if set(self.columns) <= {name.strip() for name in split_fields(header, separator)}:
                return separator
        return ","


def _text_pieces(file: BufferedReader, wanted: _Wanted, *, name: str) -> Iterator[Table]:
    with open_text(file, name=name) as text:
        lines = lines_of(text)
        header = next(lines, "")
        separator = wanted.separator(header)
        names = [column.strip() for column in split_fields(header, separator)]
        reader = _RowReader(
            names=names,
            kinds=wanted.of(names, where=f"{name} line 1"),
            name=name,
            mark="." if separator == "," else None,
        )
        for rows, numbers in split_rows(
            lines, separator=separator, first_number=2, name=name, strict=True
        ):
            yield reader.table(rows, numbers)


@dataclass(slots=True, kw_only=True)
class _RowReader:
    """Rows of text into columns: fast where all is well, one by one where something is not."""

    #: The header.
    names: list[str]
    #: Columns to read.
    kinds: dict[str, Kind]
    #: What errors call the file.
    name: str
    #: The decimal mark; None until a number has one. A later number with the other one is refused:
    #: 1,234 next to 0.5 would be read a thousand times too small.
    mark: str | None

    def table(self, rows: list[list[str]], numbers: Sequence[int]) -> Table:
        try:
            columns = self._columns(rows)
        except ValueError:
            kept = [at for at, row in enumerate(rows) if self._is_row(row, numbers[at])]
            rows, numbers = [rows[at] for at in kept], [numbers[at] for at in kept]
            columns = self._columns(rows) if rows else {}
        return Table(name=self.name, columns=columns, place=lambda at: f"line {numbers[at]}")

    def _columns(self, rows: list[list[str]]) -> dict[str, NDArray[Any]]:
        fields = dict(zip(self.names, zip(*rows, strict=True), strict=True))
        return {column: self._convert(fields[column], kind) for column, kind in self.kinds.items()}

    def _convert(self, fields: Sequence[str], kind: Kind) -> NDArray[Any]:
        if kind == "text":
            return np.array(fields, dtype=object)
        joined = "".join(fields)
        # Python reads 1_000 as a number; in a file it is a slip.
        if "_" in joined:
            raise ValueError("underscore in a number")
        for mark in ".,":
            if mark in joined:
                if self.mark not in (mark, None):
                    raise ValueError("another decimal mark")
                self.mark = mark
        if self.mark == ",":
            fields = [field.replace(",", ".") for field in fields]
        empty = np.zeros(len(fields), dtype=np.bool_)
        if kind == "number or empty":
            empty = np.array([not field.strip() for field in fields])
            fields = [field if field.strip() else "nan" for field in fields]
        numbers = np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
        if not (usable(numbers) | empty).all():
            raise ValueError("not finite")
        return numbers

    def _is_row(self, row: list[str], number: int) -> bool:
        """Return whether it is a row and no blank line; refuse what can't be used."""
        if len(row) != len(self.names):
            if not any(field.strip() for field in row):
                return False
            raise InputError(
                f"{self.name} line {number}: {len(row)} fields where the header has "
                f"{len(self.names)} ({','.join(self.names)}); fix or remove the line"
            )
        for column, kind in self.kinds.items():
            field = row[self.names.index(column)]
            try:
                self._convert([field], kind)
            except ValueError:
                where = f"{self.name} line {number}"
                _refuse(column, f"{field[:40]!a}", where=where, remedy="fix or remove the line")
        return True


def _refuse(column: str, found: str, *, where: str, remedy: str) -> NoReturn:
    raise InputError(
        f"{where}: {column} is {found}, not a finite number up to {LARGEST:g}; {remedy}"
    ) from None


def _parquet_pieces(file: BufferedReader, wanted: _Wanted, *, name: str) -> Iterator[Table]:
    from palpate.holds.binary import open_parquet

    with open_parquet(file, name=name) as parquet:
        schema = parquet.schema_arrow
        kinds = wanted.of(schema.names, where=name)
        for column, kind in kinds.items():
            _check_type(schema.field(column).type, column, kind, name=name)
        start = 0
        for batch in parquet.iter_batches(batch_size=ROWS_AT_A_TIME, columns=list(kinds)):
            columns = {
                column: _cells(batch.column(column), column, kind, start=start, name=name)
                for column, kind in kinds.items()
            }
            yield Table(name=name, columns=columns, place=_rows_from(start))
            start += batch.num_rows


def _rows_from(start: int) -> Callable[[int], str]:
    return lambda at: f"row {start + at + 1}"


def _check_type(type_: Any, column: str, kind: Kind, *, name: str) -> None:
    import pyarrow.types as types

    plain = type_.value_type if types.is_dictionary(type_) else type_
    fits = types.is_integer(plain)
    if kind == "text":
        fits |= types.is_string(plain) or types.is_large_string(plain)
    else:
        fits |= types.is_floating(plain)
    if not fits:
        wanted = "text" if kind == "text" else "numbers"
        raise InputError(f"{name}: column {column} is {plain}; it must be {wanted}")


def _cells(cells: Any, column: str, kind: Kind, *, start: int, name: str) -> NDArray[Any]:
    if kind == "text":
        from palpate.holds.binary import texts_of

        return np.array(
            [str(text) for text in texts_of(cells, column, name=name, missing="")], object
        )
    missing = cells.is_null().to_numpy(zero_copy_only=False)
    numbers = np.asarray(cells.to_numpy(zero_copy_only=False), dtype=np.float64)
    sound = usable(numbers) | (missing & (kind == "number or empty"))
    if not sound.all():
        at = int(np.argmin(sound))
        found = "missing" if missing[at] else f"{numbers[at]}"
        where = f"{name} row {start + at + 1}"
        _refuse(column, found, where=where, remedy="fill it in or remove the row")
    return numbers
