"""Rows of a study's JSON document, simple statistics, and running median."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray

Item = TypeVar("Item")
#: The levels of the twin in every simulated result.
LEVELS = ("lab", "field")


def group(items: Sequence[Item], *names: str) -> Iterator[tuple[dict[str, Any], list[Item]]]:
    """Yield groups of items with equal attributes, each with its attributes as a mapping.

    The key of a dotted name is its last part.

    Examples
    --------
    >>> for key, found in group([1 + 1j, 2 + 1j, 3 + 0j], "imag"):
    ...     print(key, len(found))
    {'imag': 1.0} 2
    {'imag': 0.0} 1
    """
    found: dict[tuple[Any, ...], list[Item]] = {}
    for item in items:
        found.setdefault(tuple(attrgetter(name)(item) for name in names), []).append(item)
    for key, same in found.items():
        yield dict(zip((name.rpartition(".")[2] for name in names), key, strict=True)), same


def mean(values: ArrayLike) -> float | None:
    """Return the mean of the finite values, None without any."""
    known = _finite(values)
    return float(np.mean(known)) if known.size else None


def median(values: ArrayLike, quantile: float = 0.5) -> float | None:
    """Return the median or another quantile of the finite values, None without any.

    Examples
    --------
    >>> median([1.0, 2.0, np.nan, 9.0]), median([])
    (2.0, None)
    """
    known = _finite(values)
    return float(np.quantile(known, quantile)) if known.size else None


def find_weighted_quantile(values: FloatArray, weights: FloatArray, quantile: float = 0.5) -> float:
    """Return the smallest value whose cumulative weight reaches a fraction of the total.

    Examples
    --------
    >>> find_weighted_quantile(np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 4.0]))
    2.0
    """
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, quantile * below[-1])])


def _finite(values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=float)
    return np.asarray(array[np.isfinite(array)])


def as_row(item: Any) -> dict[str, Any]:
    """Return a dataclass as a mapping for JSON; non-finite values become None.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Found:
    ...     force_n: float
    >>> as_row(Found(np.nan))
    {'force_n': None}
    """
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value
        for name, value in asdict(item).items()
    }


def running_median(values: ArrayLike, *, length: int) -> FloatArray:
    """Return the running median over `length` samples, ignoring NaN.

    The median removes single outliers and delays a step by half its length.

    Examples
    --------
    >>> running_median([0.0, 9.0, 0.0, 1.0], length=3).tolist()
    [0.0, 4.5, 0.0, 1.0]
    """
    signal = np.asarray(values, dtype=np.float64)
    padded = np.concatenate([np.full((length - 1, *signal.shape[1:]), np.nan), signal])
    windows = np.lib.stride_tricks.sliding_window_view(padded, length, axis=0)
    return np.asarray(np.nanmedian(windows, axis=-1))
