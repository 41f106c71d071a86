"""Holds from a file, one by one, in memory that does not grow with the file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

from palpate.holds.assemble import assemble
from palpate.holds.hold import Hold
from palpate.tables import Kind, read_pieces

_COLUMNS: dict[str, Kind] = {"hold_id": "text", "time_s": "number", "value": "number"}
_OPTIONAL: dict[str, Kind] = {"channel": "text", "unit": "text"}


def read_holds(
    path: str | os.PathLike[str],
    *,
    until_s: float = float("inf"),
    progress: Callable[[float], None] | None = None,
) -> Iterator[Hold]:
    """Read holds one by one from CSV, gzipped CSV or Parquet.

    Columns are `hold_id,time_s,value` and optionally `channel` and `unit`. The rows of a hold are
    together; channels may be interleaved within it. The unit ``percent`` (change relative to rest)
    helps to predict; others need no telling. A CSV file may have semicolons or tabs instead of
    commas, and decimal commas then. Memory is bounded by the longest hold, or by `until_s`.

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
    >>> from pathlib import Path
    >>> file = Path(tempfile.mkdtemp()) / "holds.csv"
    >>> _ = file.write_text("hold_id,time_s,value\\na,0.0,5\\na,0.1,4\\nb,0.0,7\\n")
    >>> [(hold.hold_id, hold.values.tolist()) for hold in read_holds(file)]
    [('a', [5.0, 4.0]), ('b', [7.0])]
    """
    pieces = read_pieces(path, columns=_COLUMNS, optional=_OPTIONAL, progress=progress)
    yield from assemble(pieces, name=os.fspath(path), until_s=until_s)
