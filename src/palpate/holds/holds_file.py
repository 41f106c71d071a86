"""Holds files: CSV or Parquet of known columns, read hold by hold in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.hold import Hold
from palpate.holds.strict import Kind, read_pieces
from palpate.holds.table import Table

_COLUMNS: dict[str, Kind] = {"hold_id": "text", "time_s": "number", "value": "number"}
_OPTIONAL: dict[str, Kind] = {"channel": "text", "unit": "text", "loading_s": "number"}


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
) -> Iterator[Hold]:
    """Read holds one by one from CSV, gzipped CSV or Parquet.

    Columns are `hold_id,time_s,value` and optionally `channel`, `unit` and `loading_s`. The rows of
    a hold are together; channels may be interleaved within it. The unit ``percent`` (change
    relative to rest) and a slow loading help to predict; others need not be given. A CSV file may
    have semicolons or tabs instead of commas, and decimal commas then. Memory is bounded by the
    longest hold, or by `until_s`.

    Parameters
    ----------
    path : path
        The format is recognised by content, then by ending.
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
    >>> [(hold.hold_id, hold.values.tolist()) for hold in iterate_holds(file)]
    [('a', [5.0, 4.0]), ('b', [7.0])]
    """
    pieces = read_pieces(path, columns=_COLUMNS, optional=_OPTIONAL, progress=progress)
    yield from assemble(pieces, name=os.fspath(path), until_s=until_s)


@dataclass(slots=True, kw_only=True)
class _Channel:
    """Samples of one channel gathered so far."""

    last_time_s: float = -np.inf
    time_s: list[NDArray[np.float64]] = field(default_factory=list)
    values: list[NDArray[np.float64]] = field(default_factory=list)
    unit: str | None = None
    loading_s: float = 0.0

    def add(
        self, time_s: NDArray[np.float64], values: NDArray[np.float64], *, until_s: float
    ) -> None:
        """Keep what is needed: everything before `until_s`, and the first sample from there on."""
        if self.last_time_s < until_s:
            kept = int(np.searchsorted(time_s, until_s)) + 1
            # Copies: a view would keep the whole stretch of the file in memory.
            self.time_s.append(time_s[:kept].copy())
            self.values.append(values[:kept].copy())
        self.last_time_s = float(time_s[-1])


def assemble(pieces: Iterable[Table], *, name: str, until_s: float) -> Iterator[Hold]:
    """Yield each channel of each hold once the hold is complete.

    `pieces`: the file, in order: columns `hold_id`, `time_s`, `value` and perhaps `channel` and
        `unit`. The rows of a hold are together; its channels may be interleaved.
    `until_s`: samples after the first one at or beyond this time are checked and dropped, which
        bounds the memory that one endless hold can take. Infinite to keep all.
    Raises `InputError` if time does not increase, a hold comes back or has no name.
    """
    ended: set[str] = set()
    current: str | None = None
    channels: dict[str, _Channel] = {}
    for table in pieces:
        for start, stop in _runs(table):
            hold_id = table.columns["hold_id"][start]
            if hold_id != current:
                if current is not None:
                    yield from _finish(current, channels)
                    ended.add(current)
                _check_name(hold_id, ended, where=f"{name} {table.place(start)}")
                current, channels = hold_id, {}
            _gather(table, np.arange(start, stop), channels, name=name, until_s=until_s)
    if current is not None:
        yield from _finish(current, channels)


def _runs(table: Table) -> Iterator[tuple[int, int]]:
    """Yield (start, stop) of each stretch of rows of one hold."""
    hold_id = table.columns["hold_id"]
    starts = [0, *(np.flatnonzero(hold_id[1:] != hold_id[:-1]) + 1).tolist()]
    yield from zip(starts, [*starts[1:], table.rows], strict=True)


def _check_name(hold_id: str, ended: set[str], *, where: str) -> None:
    if not hold_id.strip():
        raise InputError(f"{where}: hold_id is empty; give every hold a name")
    _check_text("hold_id", hold_id, where=where)
    if hold_id in ended:
        raise InputError(
            f"{where}: hold {hold_id} comes back after it ended; keep its rows together, "
            "or give the second one another hold_id"
        )


def _check_text(column: str, text: str, *, where: str) -> None:
    # Bytes that could not be decoded have become this sign.
    if not text.isprintable() or "\ufffd" in text:
        raise InputError(
            f"{where}: {column} {text[:40]!a} has signs that can't be printed; "
            "rename it, or save the file as UTF-8"
        )


def _gather(
    table: Table,
    indices: NDArray[np.intp],
    channels: dict[str, _Channel],
    *,
    name: str,
    until_s: float,
) -> None:
    """Add rows of one hold to its channels."""
    if "channel" not in table.columns:
        groups = {"": indices}
    else:
        labels = table.columns["channel"][indices]
        groups = {label: indices[labels == label] for label in dict.fromkeys(labels.tolist())}
    for label, members in groups.items():
        if label not in channels:
            _check_text("channel", label, where=f"{name} {table.place(int(members[0]))}")
            first = int(members[0])
            channels[label] = _Channel(
                unit=_unit(table, first, name=name), loading_s=_loading_s(table, first, name=name)
            )
        channel = channels[label]
        time_s, values = table.columns["time_s"][members], table.columns["value"][members]
        previous_s = np.concatenate(([channel.last_time_s], time_s[:-1]))
        later = time_s > previous_s
        if not later.all():
            bad = int(np.argmin(later))
            where = f"{name} {table.place(int(members[bad]))}"
            hold = f"hold {table.columns['hold_id'][members[bad]]}" + (
                f" channel {label}" if label else ""
            )
            _explain(time_s[bad], previous_s[bad], where=where, hold=hold)
        channel.add(time_s, values, until_s=until_s)


def _unit(table: Table, row: int, *, name: str) -> str | None:
    """Return the unit that the first sample of a channel has, if any."""
    if "unit" not in table.columns:
        return None
    unit: str = table.columns["unit"][row]
    _check_text("unit", unit, where=f"{name} {table.place(row)}")
    return unit or None


def _loading_s(table: Table, row: int, *, name: str) -> float:
    """Return the loading time that the first sample of a channel has, if any."""
    if "loading_s" not in table.columns:
        return 0.0
    loading_s = float(table.columns["loading_s"][row])
    if loading_s < 0:
        raise InputError(
            f"{name} {table.place(row)}: loading_s {loading_s:g} is negative; give seconds, or 0 "
            "where it is not known"
        )
    return loading_s


def _explain(time_s: float, previous_s: float, *, where: str, hold: str) -> NoReturn:
    how = "stands still" if time_s == previous_s else "goes backwards"
    raise InputError(
        f"{where}: time {how} in {hold} ({previous_s:g} s, then {time_s:g} s); "
        "sort it by time_s, or give each recording its own hold_id"
    )


def _finish(hold_id: str, channels: dict[str, _Channel]) -> Iterator[Hold]:
    for label, channel in channels.items():
        time_s, values = np.concatenate(channel.time_s), np.concatenate(channel.values)
        time_s.flags.writeable = False
        values.flags.writeable = False
        yield Hold(
            hold_id=hold_id,
            channel=label or None,
            time_s=time_s,
            values=values,
            unit=channel.unit,
            loading_s=channel.loading_s,
        )
