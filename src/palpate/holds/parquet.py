"""Rows from a Parquet file, batch by batch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError, needing
from palpate.holds.rows import OPTIONAL, REQUIRED, ROWS_AT_A_TIME, Rows, check_columns

if TYPE_CHECKING:
    import pyarrow as pa


def read_parquet(stream: BinaryIO, *, name: str) -> Iterator[Rows]:
    """Yield the rows of a Parquet file piece by piece.

    Parameters
    ----------
    stream : binary file
        Must be seekable: a Parquet file is read from its end.
    name : str
        What errors call the file.

    Raises
    ------
    InputError
        If it is not Parquet, lacks a column, has other types, or a missing value.
    MissingExtraError
        If pyarrow is not installed.
    """
    with needing(f"{name}: Parquet", extra="data"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    start = 0
    try:
        file = pq.ParquetFile(stream, pre_buffer=False)
        _check_schema(file.schema_arrow, name=name)
        wanted = [n for n in file.schema_arrow.names if n in REQUIRED + OPTIONAL]
        for batch in file.iter_batches(batch_size=ROWS_AT_A_TIME, columns=wanted):
            yield _convert(batch, start=start, name=name)
            start += batch.num_rows
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        where = f"{name} row {start + 1}" if start else name
        raise InputError(
            f"{where}: not a whole Parquet file ({reason}); copy or export it again"
        ) from error


def _check_schema(schema: pa.Schema, *, name: str) -> None:
    import pyarrow.types as kinds

    check_columns(schema.names, where=name)
    for column in schema:
        if column.name not in REQUIRED + OPTIONAL:
            continue
        kind = column.type.value_type if kinds.is_dictionary(column.type) else column.type
        number = kinds.is_floating(kind) or kinds.is_integer(kind)
        if column.name in ("time_s", "value"):
            fits, wanted = number, "numbers"
        else:
            text = kinds.is_string(kind) or kinds.is_large_string(kind)
            fits, wanted = text or kinds.is_integer(kind), "text"
        if not fits:
            raise InputError(f"{name}: column {column.name} is {column.type}; it must be {wanted}")


def _convert(batch: pa.RecordBatch, *, start: int, name: str) -> Rows:
    fields = {column: batch.column(column) for column in batch.schema.names}
    for column in REQUIRED:
        if fields[column].null_count:
            row = start + int(np.argmax(fields[column].is_null().to_numpy(zero_copy_only=False)))
            raise InputError(f"{name} row {row + 1}: no {column}; fill it in or remove the row")
    return Rows(
        hold_id=_texts(fields["hold_id"]),
        channel=_texts(fields["channel"]) if "channel" in fields else None,
        time_s=_floats(fields["time_s"]),
        values=_floats(fields["value"]),
        place=lambda index: f"row {start + index + 1}",
    )


def _floats(column: pa.Array) -> NDArray[np.float64]:
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


def _texts(column: pa.Array) -> NDArray[Any]:
    texts = ["" if text is None else str(text) for text in column.to_pylist()]
    return np.array(texts, dtype=object)
