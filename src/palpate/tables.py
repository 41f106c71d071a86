"""Plain CSV tables (or gzipped ones) of known columns, as arrays; every fault named by its line."""

from __future__ import annotations

import csv
import gzip
import os
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TextIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError

#: What a column holds: a number, a number that may be left empty (NaN), or text.
Kind: TypeAlias = Literal["number", "number or empty", "text"]


def read_table(
    path: str | os.PathLike[str], *, columns: Mapping[str, Kind]
) -> dict[str, NDArray[Any]]:
    """Read the named columns of a CSV file with a header line; other columns are passed over.

    Parameters
    ----------
    path : path
        The file; gzipped where its name ends in ``.gz``.
    columns : mapping of str to str
        Column -> ``"number"``, ``"number or empty"`` or ``"text"``.

    Returns
    -------
    dict of str to ndarray, shape (n_rows,)
        float64 for numbers (finite, or NaN where left empty), objects for text.

    Raises
    ------
    InputError
        If the file can't be read, a column is missing, or a field is not what it should be.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "loads.csv"
    >>> _ = path.write_text("step,load_n\\n1,0.5\\n2,heavy\\n")
    >>> read_table(path, columns={"step": "number"})["step"].tolist()
    [1.0, 2.0]
    >>> try:
    ...     read_table(path, columns={"load_n": "number"})
    ... except InputError as error:
    ...     print(str(error).replace(str(path), "loads.csv"))
    loads.csv line 3: load_n is 'heavy', not a finite number; mend or remove the line
    """
    name = os.fspath(path)
    try:
        with _open(Path(path)) as stream:
            return _read(csv.reader(stream, strict=True), columns, name=name)
    except (EOFError, zlib.error, gzip.BadGzipFile) as fault:
        raise InputError(
            f"{name}: the gzip data are cut or damaged; copy the file again"
        ) from fault
    except UnicodeDecodeError as fault:
        raise InputError(f"{name}: not UTF-8 text; it should be a CSV table") from fault
    except OSError as fault:
        raise InputError(f"{name}: {fault.strerror or fault}; name a CSV file") from fault


def _open(path: Path) -> TextIO:
    if path.suffix == ".gz":
        return gzip.open(path, "rt", encoding="utf-8-sig", newline="")
    return path.open(encoding="utf-8-sig", newline="")


def _read(reader: Any, columns: Mapping[str, Kind], *, name: str) -> dict[str, NDArray[Any]]:
    wanted = ",".join(columns)
    try:
        header = next(reader, None)
        if header is None:
            raise InputError(f"{name}: the file is empty; it needs a header with {wanted}")
        missing = [column for column in columns if column not in header]
        if missing:
            raise InputError(f"{name} line 1: no column {', '.join(missing)}; it needs {wanted}")
        places = {column: header.index(column) for column in columns}
        fields: dict[str, list[Any]] = {column: [] for column in columns}
        for row in reader:
            if not row:
                continue
            if len(row) != len(header):
                raise InputError(
                    f"{name} line {reader.line_num}: {len(row)} fields where the header has "
                    f"{len(header)}; mend or remove the line"
                )
            for column, kind in columns.items():
                where = f"{name} line {reader.line_num}: {column}"
                fields[column].append(_convert(row[places[column]], kind, where=where))
    except csv.Error as fault:
        raise InputError(f"{name} line {reader.line_num}: not CSV ({fault})") from fault
    if not fields[next(iter(columns))]:
        raise InputError(f"{name}: no rows after the header")
    return {column: _as_array(fields[column], columns[column]) for column in columns}


def _convert(field: str, kind: Kind, *, where: str) -> float | str:
    if kind == "text":
        return field
    if kind == "number or empty" and not field.strip():
        return float("nan")
    try:
        number = float(field)
    except ValueError:
        number = float("inf")
    if not np.isfinite(number):
        raise InputError(f"{where} is {field[:40]!a}, not a finite number; mend or remove the line")
    return number


def _as_array(values: Sequence[Any], kind: Kind) -> NDArray[Any]:
    return np.array(values, dtype=object if kind == "text" else np.float64)
