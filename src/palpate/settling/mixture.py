"""Posterior weights of the mixture components, and quantiles of the mixture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.settling.conditionals import N_DEVIATIONS, Conditionals
from palpate.settling.shapes import IS_EXPONENTIAL, N_CURVES

#: Model error, because no curve is exact: this fraction of the forecast, and this fraction of the
#: change at the recent rate per e-fold of time.
MODEL_ERROR = 0.12
#: Shape (n_components,). Deviation of each component, and whether its curve is one exponential.
_DEVIATION = np.repeat(np.arange(N_DEVIATIONS), N_CURVES)
_IS_EXPONENTIAL = np.tile(IS_EXPONENTIAL, N_DEVIATIONS)
#: Components with less than this fraction of the largest weight are ignored.
MIN_WEIGHT = 1e-3
#: Points at which the distribution is evaluated, standard deviations from the mean.
_POINTS = np.array([-3.2, -2.2, -1.6, -1.1, -0.7, -0.35, 0, 0.35, 0.7, 1.1, 1.6, 2.2, 3.2])
_GAPS = np.diff(_POINTS)[:, None]
#: A component is approximated by a logistic distribution. This is half of the inverse of its scale
#: at a standard deviation of 1.
_STEEPNESS = np.pi / np.sqrt(12.0)
#: Minimum distance of 2 p - 1 from -1 and 1 for a probability p, and minimum variance.
_RAREST, _TINY = 1e-9, float(np.finfo(float).tiny)
#: Maximum distance of a quantile from a point, standard deviations.
_MAX_STEP = 6.0


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
    #: Shape (n_components,). Whether the component's curve is a single exponential.
    is_exponential: NDArray[np.bool_]

    def exponential_probability(self) -> FloatArray:
        """Return the posterior probability of a single exponential, shape (n_holds,)."""
        return np.asarray(np.add.reduceat(self.weight * self.is_exponential, self.first))


def compute_posterior(
    forms: Conditionals, differences: FloatArray, *, noise: FloatArray, recent: FloatArray
) -> Mixture:
    """Compute the posterior weights of the components for holds on one grid.

    `differences`, shape (n_holds, m): differences of the bins to the last bin.
    `noise`, shape (n_holds,): noise variance of one sample.
    `recent`, shape (n_holds,): change from the last bin to the horizon at the recent rate.
    """
    holds, m = differences.shape
    products = differences.dot(forms.projection)
    whitened = products[:, : N_DEVIATIONS * m].reshape(holds, N_DEVIATIONS, m)
    squares = np.einsum("hkm,hkm->hk", whitened, whitened)
    squares += noise[:, None] * forms.noise_squares + forms.prior_squares
    # A weight is (handicap x unexplained squares) ** (-degrees / 2). Comparing the unexplained
    # squares selects the components without a logarithm.
    along = products[:, N_DEVIATIONS * m : -N_DEVIATIONS]
    residual = (squares[:, :, None] * forms.handicap).reshape(holds, -1)
    residual -= along * along
    smallest = np.maximum(np.minimum.reduce(residual, axis=1), 1e-12 * squares[:, 0])
    limit = smallest * MIN_WEIGHT ** (-2 / forms.degrees)
    [selected] = (residual <= limit[:, None]).ravel().nonzero()
    hold, component = np.divmod(selected, residual.shape[1])
    first = hold.searchsorted(np.arange(holds))
    smallest = smallest.take(hold)
    unexplained = np.maximum(residual.take(selected), smallest)
    weight = (smallest / unexplained) ** (forms.degrees / 2)
    weight /= np.add.reduceat(weight, first).take(hold)
    forecast = products[:, -N_DEVIATIONS:].take(N_DEVIATIONS * hold + _DEVIATION.take(component))
    forecast += forms.step.take(component) * along.take(selected)
    model_variance = MODEL_ERROR**2 * (forecast**2 + np.square(recent).take(hold))
    return Mixture(
        first=first,
        hold=hold,
        weight=weight,
        forecast=forecast,
        deviation=np.sqrt(unexplained * forms.variance.take(component) + model_variance),
        is_exponential=_IS_EXPONENTIAL[component],
    )


def compute_quantiles(mixture: Mixture, probabilities: FloatArray) -> FloatArray:
    """Return quantiles of the mixture of each hold, shape (n_probabilities, n_holds).

    Each component is approximated by a logistic distribution with its mean and deviation.

    `mixture`: must have at least one component for each hold.
    `probabilities`, shape (n_probabilities,): between 0 and 1.

    Two components of equal weight:

    >>> two = Mixture(
    ...     first=np.array([0]), hold=np.array([0, 0]),
    ...     weight=np.array([0.5, 0.5]), forecast=np.array([2.0, 4.0]),
    ...     deviation=np.array([0.5, 0.5]), is_exponential=np.array([False, False]),
    ... )
    >>> compute_quantiles(two, np.array([0.05, 0.5])).round(2).tolist()
    [[1.4], [3.0]]
    """
    first, hold, weight = mixture.first, mixture.hold, mixture.weight
    mean = np.add.reduceat(weight * mixture.forecast, first)
    offset = mixture.forecast - mean.take(hold)
    square = mixture.deviation * mixture.deviation + offset * offset
    spread = np.sqrt(np.add.reduceat(weight * square, first))
    steepness = _STEEPNESS / np.maximum(mixture.deviation, _TINY)
    cdf = _POINTS[:, None] * (spread.take(hold) * steepness)
    cdf -= offset * steepness
    np.tanh(cdf, out=cdf)
    cdf *= weight
    # The sum is 2 p - 1 for the probability p below each point. Its arctanh is nearly linear.
    known = np.add.reduceat(cdf, first, axis=1)
    known = np.arctanh(np.minimum(np.maximum(known, _RAREST - 1), 1 - _RAREST))
    target = np.arctanh(2 * probabilities - 1)[:, None]
    before = np.add.reduce(known[1:-1, None] < target, axis=0)
    holds = np.arange(mean.size)
    slope = _GAPS / np.maximum(known[1:] - known[:-1], _RAREST)
    step = (target - known[before, holds]) * slope[before, holds]
    step = np.minimum(np.maximum(step, -_MAX_STEP), _MAX_STEP)
    return np.asarray(mean + spread * (_POINTS.take(before) + step))
