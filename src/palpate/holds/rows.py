"""A stretch of rows of a holds file, whatever its format, and the columns a holds file has."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError

REQUIRED = ("hold_id", "time_s", "value")
OPTIONAL = ("channel",)

#: Rows converted at a time: enough to hide NumPy's overhead, few enough to stay in the cache
#: (65536 took three times as long per row).
ROWS_AT_A_TIME = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Consecutive rows of a file, checked for being numbers but not yet for being a hold.

    Attributes
    ----------
    hold_id : ndarray of str objects, shape (n_rows,)
        Hold of each row.
    channel : ndarray of str objects, shape (n_rows,), or None
        Channel of each row; None where the file has no such column.
    time_s, values : ndarray, shape (n_rows,)
        May still be NaN or infinite.
    place : callable
        Index of a row here -> where it stands in the file (``"line 12"``).
    """

    hold_id: NDArray[Any]
    channel: NDArray[Any] | None
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    place: Callable[[int], str]


def check_columns(names: Sequence[str], *, where: str) -> None:
    """Refuse a file without the columns of a holds file; any order, others beside them are ignored.

    Raises
    ------
    InputError
        If a column is missing, or one that is read stands there twice.

    Examples
    --------
    >>> check_columns(["", "time_s", "value", "hold_id"], where="a.csv line 1")
    >>> check_columns(["hold_id", "value"], where="a.csv line 1")
    Traceback (most recent call last):
    palpate.errors.InputError: a.csv line 1: no column time_s (it has: hold_id, value); \
a holds file has hold_id,time_s,value and optionally channel
    """
    wanted = "a holds file has hold_id,time_s,value and optionally channel"
    found = ", ".join(names)[:80]
    if not all(name.isprintable() for name in names):
        raise InputError(f"{where}: not a line of UTF-8 text; {wanted}; save it as UTF-8 CSV")
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        alone = missing == ["hold_id"]
        one = "; for a single hold it is any name, the same in each row" if alone else ""
        raise InputError(
            f"{where}: no column {', '.join(missing)} (it has: {found}); {wanted}{one}"
        )
    twice = [name for name in REQUIRED + OPTIONAL if list(names).count(name) > 1]
    if twice:
        raise InputError(f"{where}: column {twice[0]} stands there twice ({found}); {wanted}")
