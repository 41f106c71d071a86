"""In-memory tables with columns of text or numbers, and checks of numbers and rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import InputError

#: No reading is larger, and the squares of larger numbers overflow.
LARGEST_NUMBER = 1e150
#: Meters write 9.9E37 for a reading above their range (SCPI).
OPEN_NUMBER = 9.9e37
#: Rows read at a time, enough to hide NumPy's overhead and few enough for the cache (65536 rows
#: took three times as long per row).
ROWS_AT_A_TIME = 4096
#: Longest line of a text table, and longest text in other tables. The limit prevents a file without
#: line ends from filling the memory.
LONGEST_LINE = 65536
#: Unusable rows up to this fraction or number are omitted and reported. They occur if a log begins
#: or ends in the middle of a line, or a serial line loses a byte.
_MAX_BAD_FRACTION, _MAX_BAD_ROWS = 0.01, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Named columns of equal length."""

    #: Name of the file or the data in errors.
    name: str
    #: Shape (n_rows,). float64 (NaN for missing numbers, infinity for readings above the range),
    #: datetime64, timedelta64, or objects (text).
    columns: Mapping[str, NDArray[Any]]
    #: Number of each row in the file, and whether lines or rows are counted.
    numbers: Sequence[int]
    word: str = "row"
    #: One sentence for each kind of unusable row or field.
    omissions: list[str] = field(default_factory=list)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def place(self, row: int) -> str:
        """Return the location of a row in the file (``"line 12"``)."""
        return f"{self.word} {self.numbers[row]}"

    def numeric(self) -> list[str]:
        """Return the names of the columns with numbers."""
        return [
            n for n, c in self.columns.items() if c.dtype == np.float64 and np.isfinite(c).any()
        ]


def is_usable(numbers: ArrayLike) -> NDArray[np.bool_]:
    """Return which numbers are finite and at most `LARGEST_NUMBER` in magnitude.

    >>> is_usable([4700.0, float("nan"), float("-inf"), 1.7e308]).tolist()
    [True, False, False, False]
    """
    return np.asarray(np.abs(numbers) <= LARGEST_NUMBER)


def label_text(cell: object) -> str:
    """Return a label as text; a column of numbers stores 1 as 1.0.

    >>> label_text(1.0), label_text("pad 1 ")
    ('1', 'pad 1')
    """
    return f"{cell:.0f}" if isinstance(cell, float) and cell.is_integer() else str(cell).strip()


def find_runs(labels: NDArray[Any]) -> list[slice]:
    """Return slices of consecutive equal labels.

    >>> [(run.start, run.stop) for run in find_runs(np.array(["a", "a", "b"], object))]
    [(0, 2), (2, 3)]
    """
    starts = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1).tolist()]
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], labels.size], strict=True)]


def report_bad_rows(bad: Sequence[tuple[str, str]], *, total: int, name: str) -> list[str]:
    """Return a sentence about the omitted rows; no sentence without bad rows.

    `bad`: location and fault of each row.
    Raises `InputError` if there are too many; the message names the first.
    """
    if not bad:
        return []
    place, what = bad[0]
    if len(bad) > max(_MAX_BAD_ROWS, _MAX_BAD_FRACTION * total):
        raise InputError(
            f"{name} {place}: {what}; {len(bad)} of {total} rows are unusable; fix or remove them"
            if len(bad) > 1
            else f"{name} {place}: {what}; fix or remove the row"
        )
    rows = "1 row was" if len(bad) == 1 else f"{len(bad)} rows were"
    return [f"{rows} omitted (first at {place}: {what})"]
