"""Which numbers can be worked with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: No reading is larger, and of what is, squares are no numbers any more.
LARGEST = 1e150


def usable(numbers: ArrayLike) -> NDArray[np.bool_]:
    """Return which numbers are finite and not absurdly large.

    Parameters
    ----------
    numbers : array_like of float
        In any unit.

    Returns
    -------
    ndarray of bool, same shape

    Examples
    --------
    >>> usable([4700.0, float("nan"), float("-inf"), 1.7e308]).tolist()
    [True, False, False, False]
    """
    return np.asarray(np.abs(numbers) <= LARGEST)
