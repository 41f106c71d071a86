"""Sums and means of load signals over pixels.

Arrays have shape (..., rows, cols). A pixel without a reading or a rest value is NaN, and is
ignored. An infinite excess is never ignored, because an unreadable load must not count as no load.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray

#: Contact threshold of the paper (section 4.1), percent of relative change.
CONTACT_PERCENT = -10.0


def mean_change(change_percent: ArrayLike) -> FloatArray:
    """Return the mean over all pixels (the paper's aggregate): (..., rows, cols) to (...).

    >>> mean_change([[-50.0, 0.0], [float("nan"), -10.0]]).item()
    -20.0
    """
    change = np.asarray(change_percent, float)
    known = ~np.isnan(change)
    if change.size and known.all():
        # The common case, several times as fast.
        return np.asarray(change.mean(axis=(-2, -1)))
    count = known.sum(axis=(-2, -1))
    total = np.where(known, change, 0.0).sum(axis=(-2, -1))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def finger_means(change_percent: ArrayLike, *, finger_of_row: Sequence[int]) -> FloatArray:
    """Return the mean over each finger's pixels: (..., rows, cols) to (..., fingers).

    >>> finger_means([[-50.0, -30.0], [0.0, -2.0]], finger_of_row=(0, 1)).tolist()
    [-40.0, -1.0]
    """
    change = np.asarray(change_percent, float)
    means = [mean_change(change[..., rows, :]) for rows in _rows_by_finger(tuple(finger_of_row))]
    return np.stack(means, axis=-1)


@cache
def _rows_by_finger(finger_of_row: tuple[int, ...]) -> list[list[int]]:
    """Return the rows of each finger, in the order of the finger numbers."""
    return [
        [row for row, other in enumerate(finger_of_row) if other == finger]
        for finger in sorted(set(finger_of_row))
    ]


def largest_change(change_percent: ArrayLike) -> FloatArray:
    """Return the largest fall of any pixel: shape (..., rows, cols) to (...).

    >>> largest_change([[-50.0, 3.0]]).item()
    -50.0
    """
    change = np.asarray(change_percent, float)
    lowest = np.min(np.where(np.isnan(change), np.inf, change), axis=(-2, -1))
    return np.where(np.isinf(lowest), np.nan, lowest)


def total_excess(excess: ArrayLike) -> FloatArray:
    """Return the sum of excess conductances: (..., rows, cols) to (...); NaN without a reading.

    For a nearly linear law the sum hardly depends on the distribution of the force over the pixels.

    >>> total_excess([[1.0, 0.0], [float("nan"), 2.5]]).item()
    3.5
    >>> total_excess([[1.0, float("inf")]]).item()
    inf
    """
    values = np.asarray(excess, float)
    total = np.nansum(values, axis=(-2, -1))
    return np.where(np.isnan(values).all(axis=(-2, -1)), np.nan, total)
