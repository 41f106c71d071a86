"""Holds from a file, one by one, in memory that does not grow with the file."""

from __future__ import annotations

import gzip
import os
import stat
from collections.abc import Callable, Iterator
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import BinaryIO, cast

from palpate.errors import InputError
from palpate.holds.assemble import assemble
from palpate.holds.hold import Hold
from palpate.holds.parquet import read_parquet
from palpate.holds.rows import Rows
from palpate.holds.text import read_text

GZIP_MAGIC = b"\x1f\x8b"
PARQUET_MAGIC = b"PAR1"
MCAP_MAGIC = b"\x89MCA"


def read_holds(
    path: str | os.PathLike[str],
    *,
    until_s: float = float("inf"),
    progress: Callable[[float], None] | None = None,
) -> Iterator[Hold]:
    """Read holds one by one from CSV, gzipped CSV or Parquet.

    Columns are `hold_id,time_s,value` and optionally `channel`. The rows of a hold are together;
    channels may be interleaved within it. A CSV file may have semicolons or tabs instead of commas,
    and decimal commas then. Memory is bounded by the longest hold, or by `until_s`.

    Parameters
    ----------
    path : path
        Told apart by content, then by ending.
    until_s : float
        Samples after the first one at or beyond this time are checked and not kept.
    progress : callable, optional
        Called now and then with the share of the file read so far, 0 to 1.

    Yields
    ------
    Hold
        In the order of the file; channels in the order of their first sample. One-sample and
        constant holds are legitimate.

    Raises
    ------
    InputError
        At the first line (or Parquet row) that can't be used; the message names it.
    MissingExtraError
        If the file is Parquet and pyarrow is not installed.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "holds.csv"
    >>> _ = file.write_text("hold_id,time_s,value\\na,0.0,5\\na,0.1,4\\nb,0.0,7\\n")
    >>> [(hold.hold_id, hold.values.tolist()) for hold in read_holds(file)]
    [('a', [5.0, 4.0]), ('b', [7.0])]
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: a folder; name a holds file (CSV, CSV.gz or Parquet)")
    if not path.exists():
        raise InputError(f"{path}: no such file; name a holds file (CSV, CSV.gz or Parquet)")
    with path.open("rb") as file:
        pieces = _pieces(file, path)
        yield from assemble(_reporting(pieces, file, progress), name=str(path), until_s=until_s)


def _pieces(file: BufferedReader, path: Path) -> Iterator[Rows]:
    """Choose the reader by the first bytes; the ending decides only what they leave open."""
    start, ending = file.peek(4)[:4], path.suffix.lower()
    if not start:
        raise InputError(f"{path}: the file is empty; it needs hold_id,time_s,value and rows")
    if start == PARQUET_MAGIC or ending in (".parquet", ".pq"):
        yield from read_parquet(file, name=str(path))
        return
    if start == MCAP_MAGIC:
        raise InputError(f"{path}: a recording; `palpate export {path} --holds` cuts its holds out")
    packed = start[:2] == GZIP_MAGIC or ending == ".gz"
    # Undecodable bytes pass as lone surrogates, so that the error can name their line.
    with TextIOWrapper(
        cast(BinaryIO, gzip.open(file)) if packed else file,
        encoding="utf-8-sig",
        errors="surrogateescape",
        newline="",
    ) as text:
        yield from read_text(text, name=str(path))


def _reporting(
    pieces: Iterator[Rows], file: BufferedReader, progress: Callable[[float], None] | None
) -> Iterator[Rows]:
    """Pass rows through and say how far into the file they reach (pipes have no length)."""
    status = os.fstat(file.fileno())
    known = stat.S_ISREG(status.st_mode) and status.st_size > 0
    for rows in pieces:
        yield rows
        if progress is not None and known:
            progress(min(1.0, file.tell() / status.st_size))
