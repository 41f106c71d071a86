"""Interval of a non-negative quantity, from a measurement that may be negative.

An ordinary interval cut at zero can be empty, and a wider one has too much coverage near zero.
Feldman and Cousins order the possible measurements by their likelihood ratio to the best allowed
value. The interval then changes automatically from two limits to an upper limit only, and its
coverage equals its level for every true value.

Feldman and Cousins, "Unified approach to the classical statistical analysis of small signals",
Phys. Rev. D 57, 3873 (1998). There the error is normal; here it may be Student's t.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtr, stdtrit

from palpate.arrays import FloatArray

#: True values on the grid, and measurements of each.
_TRUE, _MEASURED = 200, 500


def interval_above_zero(measured: float, *, freedom: float, level: float) -> tuple[float, float]:
    """Return the limits of the interval, in standard deviations of the measurement.

    `measured`: measurement in its standard deviations; may be negative.
    `freedom`: degrees of freedom of the standard deviation.

    As in Table X of the paper, for a normal error: an upper limit only at one standard deviation
    below zero, two limits at two above.

    >>> [round(end, 1) for end in interval_above_zero(-1.0, freedom=1e6, level=0.9)]
    [0.0, 0.8]
    >>> [round(end, 1) for end in interval_above_zero(2.0, freedom=1e6, level=0.9)]
    [0.6, 3.6]
    """
    quantile = float(stdtrit(freedom, 0.5 + level / 2))
    true = np.linspace(0.0, abs(measured) + 2 * quantile, _TRUE)
    error = stdtrit(freedom, (np.arange(_MEASURED) + 0.5) / _MEASURED)

    def log_ratio(seen: ArrayLike, value: ArrayLike) -> FloatArray:
        best = np.minimum(seen, 0.0)
        return _log_likelihood(np.subtract(seen, value), freedom) - _log_likelihood(best, freedom)

    others, this = log_ratio(true[:, None] + error, true[:, None]), log_ratio(measured, true)
    inside = true[np.mean(others <= this[:, None], axis=1) >= 1 - level]
    return float(inside[0]), float(inside[-1])


def median_above_zero(measured: float, *, freedom: float) -> float:
    """Return the median of the error distribution after exclusion of negative values.

    >>> [round(median_above_zero(x, freedom=6), 1) for x in (-2.0, 0.0, 4.0)]
    [0.5, 0.7, 4.0]
    """
    probability = float(stdtr(freedom, measured))
    return measured - float(stdtrit(freedom, 0.5 * probability))


def _log_likelihood(error: ArrayLike, freedom: float) -> FloatArray:
    return np.asarray(-0.5 * (freedom + 1) * np.log1p(np.square(error) / freedom))
