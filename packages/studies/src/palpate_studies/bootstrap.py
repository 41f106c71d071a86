"""Bootstrap intervals over specimens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

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
    """Return a percentile interval of a statistic, resampling whole groups with replacement.

    Holds of one specimen are correlated, so resampling single holds would give too narrow an
    interval.

    Parameters
    ----------
    values : ndarray, shape (n_holds,)
        One value per hold; NaN values are ignored.
    groups : sequence of str, length n_holds
        Specimen of each hold.
    statistic : callable
        Function of an array of finite values, such as `np.mean` or `np.median`.
    level, draws, seed : float, int, int
        Confidence level, number of resamples, random seed.

    Returns
    -------
    tuple of float
        Lower and upper limit; NaN with fewer than two groups.

    References
    ----------
    A. C. Davison and D. V. Hinkley, "Bootstrap Methods and their Application" (1997), section 3.8.

    Examples
    --------
    >>> values = np.array([1.0, 1.0, 0.0, 1.0])
    >>> bootstrap_interval(values, ["a", "a", "b", "c"], statistic=np.mean)
    (0.3333333333333333, 1.0)
    """
    finite = np.isfinite(values)
    labels = np.array(groups, dtype=object)[finite]
    members = [values[finite][labels == group] for group in dict.fromkeys(labels)]
    if len(members) < 2:
        return float("nan"), float("nan")
    random = np.random.default_rng(seed)
    drawn = random.integers(len(members), size=(draws, len(members)))
    results = [statistic(np.concatenate([members[index] for index in draw])) for draw in drawn]
    low, high = np.quantile(results, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)
