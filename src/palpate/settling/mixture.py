"""Posterior weights of the mixture components, and quantiles of the mixture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.settling.conditionals import N_DEVIATIONS, Conditionals
from palpate.settling.shapes import IS_EXPONENTIAL, N_CURVES

#: Shape (n_components,). Whether the component's curve is a single exponential.
_IS_EXPONENTIAL = np.tile(IS_EXPONENTIAL, N_DEVIATIONS)
#: Components with less than this fraction of the largest weight are ignored.
MIN_WEIGHT = 1e-3
#: Shape (n_points, 1). Points at which the distribution is evaluated, standard deviations from the
#: mean, and the gaps after them, shape (n_points - 1,).
_POINTS = np.array([-3.2, -2.2, -1.6, -1.1, -0.7, -0.35, 0, 0.35, 0.7, 1.1, 1.6, 2.2, 3.2])[:, None]
_GAPS = np.diff(_POINTS[:, 0])
#: Smallest and largest fraction of each gap before a quantile. Beyond the points the first and the
#: last gap are continued, by at most this many standard deviations.
_MAX_STEP = 6.0
_LEAST, _MOST = np.zeros((2, _GAPS.size, 1, 1))
_MOST += 1
_LEAST[0], _MOST[-1] = -_MAX_STEP / _GAPS[0], _MAX_STEP / _GAPS[-1]
#: A component is approximated by a logistic distribution. This is half of the inverse of its scale
#: at a standard deviation of 1.
STEEPNESS = np.pi / np.sqrt(12.0)
#: Minimum distance of 2 p - 1 from -1 and 1 for a probability p.
_RAREST = 1e-9


class Mixture(NamedTuple):
    """Components with relevant weight, grouped by hold, and their forecasts."""

    #: Shape (n_holds,). Index of the first component of each hold.
    first: NDArray[np.intp]
    #: Shape (n_components,). Hold of each component, in ascending order.
    hold: NDArray[np.intp]
    #: Shape (n_components,). Posterior probability; change from the last bin to the horizon, and
    #: its standard deviation.
    weight: FloatArray
    forecast: FloatArray
    deviation: FloatArray
    #: Shape (n_components,). Number of the component.
    component: NDArray[np.intp]

    def exponential_probability(self) -> FloatArray:
        """Return the posterior probability of a single exponential, shape (n_holds,)."""
        is_exponential = _IS_EXPONENTIAL.take(self.component)
        return np.asarray(np.add.reduceat(self.weight * is_exponential, self.first))


def compute_posterior(
    forms: Conditionals, differences: FloatArray, *, noise: FloatArray
) -> Mixture:
    """Compute the posterior weights of the components for holds on one grid.

    `differences`, shape (n_holds, m): differences of the bins to the last bin.
    `noise`, shape (n_holds,): noise variance of one sample.
    """
    holds, m = differences.shape
    whitened = forms.whitening @ differences.T
    along = forms.along @ whitened[:, :m]
    squares = np.add.reduce(whitened[:, :m] ** 2, axis=1)
    squares += noise * forms.noise_squares + forms.prior_squares
    # A weight is (handicap x unexplained squares) ** (-degrees / 2). Comparing the unexplained
    # squares selects the components without a logarithm.
    residual = ((squares[:, None] - along * along) * forms.handicap).reshape(-1, holds)
    smallest = np.minimum.reduce(residual, axis=0)
    is_relevant = residual <= smallest * MIN_WEIGHT ** (-2 / forms.degrees)
    hold, component = np.ascontiguousarray(is_relevant.T).nonzero()
    first = hold.searchsorted(np.arange(holds))
    place = component * holds + hold
    unexplained = residual.take(place)
    weight = (smallest.take(hold) / unexplained) ** (forms.degrees / 2)
    weight /= np.add.reduceat(weight, first).take(hold)
    forecast = forms.gain.take(component) * along.take(place)
    forecast -= whitened[component // N_CURVES, m, hold]
    deviation = np.sqrt(unexplained * forms.variance.take(component))
    return Mixture(first, hold, weight, forecast, deviation, component)


def compute_quantiles(mixture: Mixture, log_odds: FloatArray) -> FloatArray:
    """Return quantiles of the mixture of each hold, shape (n_quantiles, n_holds).

    Each component is approximated by a logistic distribution with its mean and deviation.

    `mixture`: must have at least one component for each hold, and positive deviations.
    `log_odds`, shape (n_quantiles, 1): half of ln(p / (1 - p)) for each probability p.

    Two components of equal weight:

    >>> two = Mixture(
    ...     first=np.array([0]), hold=np.array([0, 0]),
    ...     weight=np.array([0.5, 0.5]), forecast=np.array([2.0, 4.0]),
    ...     deviation=np.array([0.5, 0.5]), component=np.array([0, 1]),
    ... )
    >>> compute_quantiles(two, np.arctanh([[-0.9], [0.0]])).round(2).tolist()
    [[1.4], [3.0]]
    """
    first, hold, weight = mixture.first, mixture.hold, mixture.weight
    mean = np.add.reduceat(weight * mixture.forecast, first)
    offset = mixture.forecast - mean.take(hold)
    square = mixture.deviation * mixture.deviation + offset * offset
    spread = np.sqrt(np.add.reduceat(weight * square, first))
    steepness = STEEPNESS / mixture.deviation
    cdf = np.tanh(_POINTS * (spread.take(hold) * steepness) - offset * steepness)
    cdf *= weight
    # The sum is 2 p - 1 for the probability p below each point. Its arctanh is nearly linear.
    known = np.add.reduceat(cdf, first, axis=1)
    known *= 1 - _RAREST
    known = np.arctanh(known)
    gap = np.maximum(known[1:] - known[:-1], _RAREST)
    fraction = (log_odds - known[:-1, None]) / gap[:, None]
    fraction = np.minimum(np.maximum(fraction, _LEAST), _MOST)
    steps = _GAPS.dot(fraction.reshape(_GAPS.size, -1)).reshape(-1, mean.size)
    found = mean + spread * (steps + _POINTS[0])
    # Between separate components the points are too far apart. The quantile of a mixture is within
    # those of its components.
    reach = log_odds * (mixture.deviation / STEEPNESS)
    reach += mixture.forecast
    least = np.minimum.reduceat(reach, first, axis=1)
    most = np.maximum.reduceat(reach, first, axis=1)
    return np.asarray(np.minimum(np.maximum(found, least), most))
