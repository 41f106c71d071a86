"""A table as columns of text or numbers, and which numbers can be worked with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: No reading is larger, and of what is, squares are no numbers any more.
LARGEST = 1e150


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Named columns of equal length."""

    #: What errors call the file or the data.
    name: str
    #: Shape (n_rows,). float64 (NaN where there is no number), datetime64, timedelta64, or objects
    #: (text).
    columns: Mapping[str, NDArray[Any]]
    #: Row -> its place in the file (``"line 12"``).
    place: Callable[[int], str]
    #: One sentence for each kind of row or field that couldn't be used.
    left_out: list[str] = field(default_factory=list)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def numeric(self) -> list[str]:
        """Names of the columns that hold numbers."""
        return [
            n for n, c in self.columns.items() if c.dtype == np.float64 and np.isfinite(c).any()
        ]


def unique_names(names: list[str]) -> list[str]:
    """Return names with none empty and none twice.

    >>> unique_names(["t", "", "A", "A"])
    ['t', 'column 2', 'A', 'A (4)']
    """
    found: list[str] = []
    for number, name in enumerate(names, start=1):
        name = " ".join(name.split()) or f"column {number}"
        found.append(name if name not in found else f"{name} ({number})")
    return found


def usable(numbers: ArrayLike) -> NDArray[np.bool_]:
    """Return which numbers are finite and not absurdly large.

    >>> usable([4700.0, float("nan"), float("-inf"), 1.7e308]).tolist()
    [True, False, False, False]
    """
    return np.asarray(np.abs(numbers) <= LARGEST)
