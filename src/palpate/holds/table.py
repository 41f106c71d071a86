"""A table as columns of text or numbers, and its usable numbers and rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import InputError

#: No reading is larger, and of what is, squares are no numbers any more.
LARGEST = 1e150
#: Rows read at a time: enough to hide NumPy's overhead, few enough to stay in the cache (65536 took
#: three times as long per row).
ROWS_AT_A_TIME = 4096
#: No line of a text table is longer, and no text in another: a file without line ends must not be
#: read into memory whole.
LONGEST_LINE = 65536
#: Rows that can't be used are left out, and reported, up to this share: a log that begins or ends
#: in the middle of a line, a byte lost on a serial line.
_BAD_SHARE, _BAD_AT_LEAST = 0.01, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Named columns of equal length."""

    #: What errors call the file or the data.
    name: str
    #: Shape (n_rows,). float64 (NaN where there is no number), datetime64, timedelta64, or objects
    #: (text).
    columns: Mapping[str, NDArray[Any]]
    #: Of each row in the file, and whether they count lines or rows.
    numbers: Sequence[int]
    word: str = "row"
    #: One sentence for each kind of row or field that couldn't be used.
    left_out: list[str] = field(default_factory=list)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def place(self, row: int) -> str:
        """Return the place of a row in the file (``"line 12"``)."""
        return f"{self.word} {self.numbers[row]}"

    def numeric(self) -> list[str]:
        """Names of the columns that hold numbers."""
        return [
            n for n, c in self.columns.items() if c.dtype == np.float64 and np.isfinite(c).any()
        ]


def is_usable(numbers: ArrayLike) -> NDArray[np.bool_]:
    """Return which numbers are finite and not absurdly large.

    >>> is_usable([4700.0, float("nan"), float("-inf"), 1.7e308]).tolist()
    [True, False, False, False]
    """
    return np.asarray(np.abs(numbers) <= LARGEST)


def runs_of(labels: NDArray[Any]) -> list[slice]:
    """Return the stretches of equal labels.

    >>> [(run.start, run.stop) for run in runs_of(np.array(["a", "a", "b"], object))]
    [(0, 2), (2, 3)]
    """
    starts = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1).tolist()]
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], labels.size], strict=True)]


def refuse_or_report(bad: Sequence[tuple[str, str]], *, total: int, name: str) -> list[str]:
    """Return a sentence about rows that are left out, where they are few.

    `bad`: the place of each such row, and what is wrong with it.
    Raises `InputError` if they are many; the message has the first of them.
    """
    if not bad:
        return []
    place, what = bad[0]
    if len(bad) > max(_BAD_AT_LEAST, _BAD_SHARE * total):
        raise InputError(
            f"{name} {place}: {what}, and so are {len(bad) - 1} more of {total} rows; fix or "
            "remove them"
            if len(bad) > 1
            else f"{name} {place}: {what}; fix or remove it"
        )
    rows = "1 row was" if len(bad) == 1 else f"{len(bad)} rows were"
    return [f"{rows} left out (first at {place}: {what})"]
