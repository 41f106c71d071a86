"""An interval of a figure over specimens, by drawing whole specimens again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray


def bootstrap_interval(
    values: FloatArray,
    groups: Sequence[str],
    *,
    statistic: Callable[[FloatArray], np.floating[Any]],
    level: float = 0.9,
    draws: int = 1000,
    seed: int = 0,
) -> tuple[float, float]:
    """Return a percentile interval of a statistic, drawing whole groups with replacement.

    Holds of one specimen resemble each other; drawing single holds would promise too much.

    Parameters
    ----------
    values : ndarray, shape (n_holds,)
        One figure for each hold; NaN ones are left out.
    groups : sequence of str, length n_holds
        Specimen of each hold.
    statistic : callable
        Of an array of finite values: `np.mean`, `np.median`.
    level, draws, seed : float, int, int
        Probability inside the interval, number of draws, seed of the draws.

    Returns
    -------
    tuple of float
        Low and high end; NaN where there are fewer than two groups.

    References
    ----------
    A. C. Davison and D. V. Hinkley, "Bootstrap Methods and their Application" (1997), section 3.8.

    Examples
    --------
    >>> values = np.array([1.0, 1.0, 0.0, 1.0])
    >>> bootstrap_interval(values, ["a", "a", "b", "c"], statistic=np.mean)
    (0.3333333333333333, 1.0)
    """
    kept = np.isfinite(values)
    members = _members(values[kept], [g for g, keep in zip(groups, kept, strict=True) if keep])
    if len(members) < 2:
        return float("nan"), float("nan")
    random = np.random.default_rng(seed)
    drawn = random.integers(len(members), size=(draws, len(members)))
    results = [statistic(np.concatenate([members[index] for index in draw])) for draw in drawn]
    low, high = np.quantile(results, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def _members(values: FloatArray, groups: Sequence[str]) -> list[NDArray[np.float64]]:
    labels = np.array(groups, dtype=object)
    return [values[labels == group] for group in dict.fromkeys(groups)]
