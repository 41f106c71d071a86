"""Weighing the components by the samples, and reading quantiles off their mixture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.settling.conditionals import (
    DEVIATION_OF,
    N_DEVIATIONS,
    NOISE,
    SCALE_DEGREES,
    Conditionals,
)

#: Scale of the change of ln R from 0.3 to 20 s, where it is known: sheets and soft materials creep
#: by a tenth to a half (median drops of five real materials: .08 to .4).
SCALE = 0.18
#: No curve is the truth: each forecast may have this relative error, and this share of the change
#: that the recent pace per e-fold of time would bring.
SHAPE_DOUBT = 0.08
#: Components that weigh less than this fraction of the heaviest one change no digit that matters.
LIGHTEST = 1e-3
#: Where the probability is worked out, standard deviations from the mean.
_PLACES = np.array([-3.2, -2.2, -1.6, -1.1, -0.7, -0.35, 0, 0.35, 0.7, 1.1, 1.6, 2.2, 3.2])
#: A component is taken as logistic: half of the inverse of its scale at a standard deviation of 1.
_STEEPNESS = np.pi / np.sqrt(12.0)
#: Twice a probability less one is kept this far from -1 and 1, and no variance is smaller.
_RAREST, _TINY = 1e-9, float(np.finfo(float).tiny)
#: How far beyond a place a quantile may lie.
_BEYOND = 6.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mixture:
    """Components that matter, hold by hold, and their forecasts."""

    #: Shape (n_holds,). First entry of each hold.
    first: NDArray[np.intp]
    #: Shape (n_kept,). Which hold each entry is of, increasing from 0.
    hold: NDArray[np.intp]
    #: Shape (n_kept,). Posterior probability, change from the last bin to the horizon and its
    #: standard deviation.
    weight: FloatArray
    forecast: FloatArray
    deviation: FloatArray


def posterior(forms: Conditionals, seen: FloatArray, *, noise: FloatArray, scaled: bool) -> Mixture:
    """Weigh the components by the binned samples of holds on one grid.

    `seen`, shape (n_holds, m): differences of the bins to the last one.
    `noise`, shape (n_holds,): noise variance of one sample.
    `scaled`: as of `conditionals`.
    """
    holds, m = seen.shape
    whitened = (seen @ forms.whitening).reshape(holds, N_DEVIATIONS, m)
    squares = np.einsum("hkm,hkm->hk", whitened, whitened)
    squares += noise[:, None] * (forms.noise_samples / NOISE**2)
    squares += scaled * SCALE_DEGREES * SCALE**2 + _TINY
    # A weight is handicap x unexplained squares, to the power of -degrees / 2: whether it counts is
    # known without taking a logarithm.
    along = seen @ forms.along
    left = squares @ forms.handicap
    left -= np.square(along)
    least = np.maximum(left.min(axis=1), 1e-12 * squares.min(axis=1))
    [kept] = (left <= (least * LIGHTEST ** (-2 / forms.degrees))[:, None]).ravel().nonzero()
    hold = kept // DEVIATION_OF.size
    component = kept - hold * DEVIATION_OF.size
    first = hold.searchsorted(np.arange(holds))
    least = least[hold]
    unexplained = np.maximum(left.take(kept), least)
    weight = np.exp(-forms.degrees / 2 * np.log(unexplained / least))
    weight /= np.add.reduceat(weight, first)[hold]
    forecast = (seen @ forms.ahead).take(hold * N_DEVIATIONS + DEVIATION_OF[component])
    forecast += forms.step[component] * along.take(kept)
    pace = forms.pace * seen[:, forms.pace_from][hold]
    doubt = SHAPE_DOUBT**2 * (forecast**2 + pace**2)
    return Mixture(
        first=first,
        hold=hold,
        weight=weight,
        forecast=forecast,
        deviation=np.sqrt(unexplained * forms.variance[component] + doubt),
    )


def quantiles(mixture: Mixture, shares: FloatArray) -> FloatArray:
    """Return quantiles of the mixture of each hold.

    Each component is taken as a logistic variable of its mean and deviation.

    `mixture`: every hold has a component at least.
    `shares`, shape (n_shares,): probabilities, between 0 and 1.

    Two components of equal weight:

    >>> two = Mixture(
    ...     first=np.array([0]), hold=np.array([0, 0]),
    ...     weight=np.array([0.5, 0.5]), forecast=np.array([2.0, 4.0]),
    ...     deviation=np.array([0.5, 0.5]),
    ... )
    >>> quantiles(two, np.array([0.05, 0.5])).round(2).tolist()
    [[1.4], [3.0]]
    """
    first, hold, weight = mixture.first, mixture.hold, mixture.weight
    middle = np.add.reduceat(weight * mixture.forecast, first)
    off = mixture.forecast - middle[hold]
    spread = np.sqrt(np.add.reduceat(weight * (mixture.deviation**2 + off**2), first))
    steep = _STEEPNESS / np.maximum(mixture.deviation, _TINY)
    tilt = _PLACES[:, None] * (spread[hold] * steep)
    tilt -= off * steep
    np.tanh(tilt, out=tilt)
    tilt *= weight
    # Twice the probability below each place, less one; its arctanh is nearly a line.
    known = np.add.reduceat(tilt, first, axis=1)
    known = np.arctanh(np.minimum(np.maximum(known, _RAREST - 1), 1 - _RAREST))
    wanted = np.arctanh(2 * shares - 1)[:, None]
    after = 1 + (known[1:-1, None] < wanted).sum(axis=0)
    every, before = np.arange(middle.size), after - 1
    low, start = known[before, every], _PLACES[before]
    slope = (_PLACES[after] - start) / np.maximum(known[after, every] - low, _RAREST)
    step = np.minimum(np.maximum((wanted - low) * slope, -_BEYOND), _BEYOND)
    return np.asarray(middle + spread * (start + step))
