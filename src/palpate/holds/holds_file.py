"""Reader of holds files (CSV or Parquet), hold by hold in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.hold import Hold
from palpate.holds.strict import Kind, read_chunks
from palpate.holds.table import Table, find_runs

_COLUMNS: dict[str, Kind] = {"hold_id": "text", "time_s": "number", "value": "number"}
_OPTIONAL: dict[str, Kind] = {"channel": "text", "unit": "text"}


def read_holds(path: str | os.PathLike[str], *, until_s: float = float("inf")) -> list[Hold]:
    """Read the holds of a file: CSV, gzipped CSV or Parquet.

    Parameters
    ----------
    path, until_s
        As for `iterate_holds`.

    Returns
    -------
    list of Hold
        In the order of the file.

    Raises
    ------
    InputError, MissingExtraError
        As `iterate_holds`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> file = Path(tempfile.mkdtemp()) / "holds.csv"
    >>> _ = file.write_text("hold_id,time_s,value\\na,0.0,5\\na,0.1,4\\n")
    >>> read_holds(file)
    [Hold('a', 2 samples, 0 to 0.1 s)]
    """
    return list(iterate_holds(path, until_s=until_s))


def iterate_holds(
    path: str | os.PathLike[str],
    *,
    until_s: float = float("inf"),
    progress: Callable[[float], None] | None = None,
) -> Generator[Hold, None, None]:
    """Read holds one by one from CSV, gzipped CSV or Parquet.

    Columns are `hold_id,time_s,value` and optionally `channel` and `unit`. The rows of
    a hold must be contiguous; its channels may be interleaved. Predictors use only the unit
    ``percent`` (change relative to rest). A CSV file may use
    semicolons or tabs instead of commas, and then also decimal commas. Memory is bounded by the
    longest hold, or by `until_s`.

    Parameters
    ----------
    path : path
        The format is recognised from the content, then from the file extension.
    until_s : float
        Samples after the first one at or beyond this time are checked but not returned.
    progress : callable, optional
        Called periodically with the fraction of the file read so far, 0 to 1.

    Yields
    ------
    Hold
        In the order of the file; channels in the order of their first sample. Holds with one sample
        or constant values are valid.

    Raises
    ------
    InputError
        At the first invalid line (or Parquet row); the message contains its number.
    MissingExtraError
        If the file is Parquet and pyarrow is not installed.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> file = Path(tempfile.mkdtemp()) / "holds.csv"
    >>> _ = file.write_text("hold_id,time_s,value\\na,0.0,5\\na,0.1,4\\nb,0.0,7\\n")
    >>> [(hold.hold_id, hold.values.tolist()) for hold in iterate_holds(file)]
    [('a', [5.0, 4.0]), ('b', [7.0])]
    """
    name, current, channels = os.fspath(path), "", dict[str, _Channel]()
    ended: set[str] = set()
    # Closed here: a traceback may keep the generator, and so its file, long after an error.
    with closing(
        read_chunks(path, columns=_COLUMNS, optional=_OPTIONAL, progress=progress)
    ) as tables:
        for table in tables:
            for rows in find_runs(table.columns["hold_id"]):
                hold_id = table.columns["hold_id"][rows.start]
                if hold_id != current or not channels:
                    yield from _build_holds(current, channels)
                    ended.add(current)
                    _check_name(hold_id, ended, where=f"{name} {table.place(rows.start)}")
                    current, channels = hold_id, {}
                for channel_rows in _split_channels(table, rows):
                    _add_rows(table, channel_rows, channels, name=name, until_s=until_s)
    yield from _build_holds(current, channels)


@dataclass(slots=True, kw_only=True)
class _Channel:
    """Samples of one channel read so far."""

    last_time_s: float = -np.inf
    time_s: list[NDArray[np.float64]] = field(default_factory=list)
    values: list[NDArray[np.float64]] = field(default_factory=list)
    unit: str | None = None

    def add(
        self, time_s: NDArray[np.float64], values: NDArray[np.float64], *, until_s: float
    ) -> None:
        """Store the samples before `until_s` and the first sample at or after it."""
        if self.last_time_s < until_s:
            count = int(np.searchsorted(time_s, until_s)) + 1
            # A view would keep the whole chunk of the file in memory.
            self.time_s.append(time_s[:count].copy())
            self.values.append(values[:count].copy())
        self.last_time_s = float(time_s[-1])


def _check_name(hold_id: str, ended: set[str], *, where: str) -> None:
    if not hold_id.strip():
        raise InputError(f"{where}: hold_id is empty; name every hold")
    _check_text("hold_id", hold_id, where=where)
    if hold_id in ended:
        raise InputError(
            f"{where}: the rows of hold {hold_id} are not contiguous; put them together, "
            "or give the second part another hold_id"
        )


def _check_text(column: str, text: str, *, where: str) -> None:
    # U+FFFD replaces bytes that could not be decoded.
    if not text.isprintable() or "\ufffd" in text:
        raise InputError(
            f"{where}: {column} {text[:40]!a} contains unprintable characters; "
            "rename it, or save the file as UTF-8"
        )


def _split_channels(table: Table, rows: slice) -> Iterator[NDArray[np.intp]]:
    """Yield the rows of each channel of one hold; channels may be interleaved."""
    indices = np.arange(rows.start, rows.stop)
    if "channel" not in table.columns:
        yield indices
        return
    labels = table.columns["channel"][rows]
    for label in dict.fromkeys(labels.tolist()):
        yield indices[labels == label]


def _add_rows(
    table: Table,
    rows: NDArray[np.intp],
    channels: dict[str, _Channel],
    *,
    name: str,
    until_s: float,
) -> None:
    """Add rows of one channel of a hold to `channels`."""
    first = int(rows[0])
    cells = {n: table.columns[n][first] for n in (*_COLUMNS, *_OPTIONAL) if n in table.columns}
    label = cells.get("channel", "")
    if label not in channels:
        where = f"{name} {table.place(first)}"
        for column in ("channel", "unit"):
            _check_text(column, cells.get(column, ""), where=where)
        channels[label] = _Channel(unit=cells.get("unit") or None)
    channel = channels[label]
    time_s, values = table.columns["time_s"][rows], table.columns["value"][rows]
    previous_s = np.concatenate(([channel.last_time_s], time_s[:-1]))
    later = time_s > previous_s
    if not later.all():
        bad = int(np.argmin(later))
        how = "is repeated" if time_s[bad] == previous_s[bad] else "decreases"
        hold = f"hold {cells['hold_id']}" + (f" channel {label}" if label else "")
        raise InputError(
            f"{name} {table.place(int(rows[bad]))}: time {how} in {hold} ({previous_s[bad]:g} s, "
            f"then {time_s[bad]:g} s); sort the rows by time_s, or give each recording its own "
            "hold_id"
        )
    channel.add(time_s, values, until_s=until_s)


def _build_holds(hold_id: str, channels: dict[str, _Channel]) -> Iterator[Hold]:
    for label, channel in channels.items():
        time_s, values = np.concatenate(channel.time_s), np.concatenate(channel.values)
        time_s.flags.writeable = values.flags.writeable = False
        yield Hold(
            hold_id=hold_id,
            channel=label or None,
            time_s=time_s,
            values=values,
            unit=channel.unit,
        )
