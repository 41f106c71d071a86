"""Weighing the components by the samples, and reading quantiles off their mixture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from palpate.settling.conditionals import NOISE, Conditionals
from palpate.settling.result import FloatArray

#: Scale of the change of ln R from 0.3 to 20 s, and how many samples' worth that is known: sheets
#: creep by a tenth, rarely by less than a fiftieth or more than a half.
SCALE, SCALE_DEGREES = 0.1, 6.0
#: No curve is the truth: each forecast may be off by this share of itself, and of the change that
#: the recent pace per e-fold of time would bring.
SHAPE_DOUBT = 0.05
#: Components that weigh less than this share of the heaviest one change no digit that matters.
LIGHTEST = 1e-4
#: Components with nearly the same forecast are merged before quantiles are sought: bins across so
#: many standard deviations to either side.
_MERGED, _SPAN = 24, 3.0
#: Newton steps towards a quantile, held in a bracket.
_STEPS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mixture:
    """Components that matter, hold by hold, and their forecasts.

    Attributes
    ----------
    holds : int
        Number of holds.
    hold, component : ndarray of int, shape (n_kept,)
        Which hold each entry is of, and which component, counted deviation by deviation.
    weight, forecast, deviation : ndarray, shape (n_kept,)
        Posterior probability, change from the last bin to the horizon and its standard deviation.
    """

    holds: int
    hold: NDArray[np.intp]
    component: NDArray[np.intp]
    weight: FloatArray
    forecast: FloatArray
    deviation: FloatArray

    def doubted(self, pace: FloatArray) -> Mixture:
        """Return the mixture, each forecast in doubt of its shape.

        `pace` is the change that the recent pace brings, shape (n_holds,).
        """
        doubt = SHAPE_DOUBT * np.hypot(self.forecast, pace[self.hold])
        return replace(self, deviation=np.hypot(self.deviation, doubt))

    def sums(self, terms: FloatArray) -> FloatArray:
        """Return the sum of a term over the components of each hold, shape (n_holds,)."""
        return np.bincount(self.hold, weights=terms, minlength=self.holds)


def posterior(
    forms: Conditionals,
    binned: FloatArray,
    *,
    log_odds: FloatArray,
    scatter: tuple[FloatArray, float],
    scaled: bool,
    lightest: float = LIGHTEST,
) -> Mixture:
    """Weigh the components by the binned samples of holds on one grid.

    Parameters
    ----------
    forms : Conditionals
        Of the grid.
    binned : ndarray, shape (n_holds, n_bins)
        Averages over the bins.
    log_odds : ndarray, shape (n_deviations, n_curves)
        Prior log odds.
    scatter : tuple of ndarray, shape (n_holds,), and float
        Noise variance of one sample, and the number of samples it counts for.
    scaled : bool
        Whether the values are ln R, whose scale is known roughly; of other units nothing is.
    lightest : float
        Components that weigh less than this share of the heaviest are dropped.
    """
    variance, samples = scatter
    degrees = binned.shape[1] - 1 + samples + scaled * SCALE_DEGREES
    seen = binned[:, :-1] - binned[:, -1:]
    whitened = np.swapaxes(forms.whitening @ seen.T, 1, 2)
    squares = np.einsum("knm,knm->kn", whitened, whitened) + scaled * SCALE_DEGREES * SCALE**2
    squares += samples * variance / NOISE[:, None] ** 2
    along = whitened @ forms.curves
    left = np.maximum(squares[:, :, None] - along**2, np.finfo(float).tiny)
    prior = forms.log_weight + log_odds - samples * np.log(NOISE)[:, None]
    log_weight = prior[:, None] - degrees / 2 * np.log(left)
    heaviest = log_weight.max(axis=(0, 2))
    kept = np.nonzero(log_weight > (heaviest + np.log(lightest))[:, None])
    deviation, hold, curve = kept
    weight = np.exp(log_weight[kept] - heaviest[hold])
    weight /= np.bincount(hold, weights=weight)[hold]
    base = np.einsum("knm,km->kn", whitened, forms.ahead)
    return Mixture(
        holds=len(binned),
        hold=hold,
        component=deviation * log_odds.shape[1] + curve,
        weight=weight,
        forecast=base[deviation, hold] + forms.step[deviation, curve] * along[kept],
        deviation=np.sqrt(left[kept] / max(degrees - 2, 1) * forms.variance[deviation, curve]),
    )


def quantiles(mixture: Mixture, shares: FloatArray) -> FloatArray:
    """Return quantiles of the mixture of each hold.

    Parameters
    ----------
    mixture : Mixture
        Every hold has a component at least.
    shares : ndarray, shape (n_shares,)
        Probabilities, between 0 and 1.

    Returns
    -------
    ndarray, shape (n_shares, n_holds)

    Examples
    --------
    Two components of equal weight:

    >>> two = Mixture(
    ...     holds=1, hold=np.array([0, 0]), component=np.array([0, 1]), weight=np.array([0.5, 0.5]),
    ...     forecast=np.array([-1.0, 1.0]), deviation=np.array([0.5, 0.5]),
    ... )
    >>> quantiles(two, np.array([0.05, 0.5])).round(2).tolist()
    [[-1.64], [0.0]]
    """
    weight, mean, deviation = _merge(mixture)
    middle = np.einsum("hb,hb->h", weight, mean)
    spread = np.sqrt(np.einsum("hb,hb->h", weight, deviation**2 + (mean - middle[:, None]) ** 2))
    found = np.empty((shares.size, mixture.holds))
    for row, share in enumerate(shares):
        # Whatever the shape, no quantile is further off than this (Cantelli's inequality).
        low = middle - spread * np.sqrt((1 - share) / share)
        high = middle + spread * np.sqrt(share / (1 - share))
        at = np.clip(middle + spread * ndtri(share), low, high)
        for _ in range(_STEPS):
            z = (at[:, None] - mean) / deviation
            short = share - np.einsum("hb,hb->h", weight, ndtr(z))
            low, high = np.where(short > 0, at, low), np.where(short > 0, high, at)
            slope = np.einsum("hb,hb->h", weight / deviation, np.exp(-0.5 * z**2))
            step = short * np.sqrt(2 * np.pi) / np.maximum(slope, np.finfo(float).tiny)
            inside = (at + step > low) & (at + step < high)
            at = np.where(inside, at + step, (low + high) / 2)
        found[row] = at
    return found


def _merge(mixture: Mixture) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return weights, means and deviations, shape (n_holds, n_merged); empty ones weigh nothing."""
    hold, weight, forecast = mixture.hold, mixture.weight, mixture.forecast
    middle = mixture.sums(weight * forecast)
    off = forecast - middle[hold]
    spread = np.sqrt(mixture.sums(weight * (mixture.deviation**2 + off**2)))
    spread = np.maximum(spread, np.finfo(float).tiny)
    place = (off / spread[hold] + _SPAN) * (_MERGED / (2 * _SPAN))
    place = np.clip(place, 0, _MERGED - 1).astype(np.intp) + hold * _MERGED

    def gathered(terms: FloatArray) -> FloatArray:
        sums = np.bincount(place, weights=terms, minlength=mixture.holds * _MERGED)
        return sums.reshape(mixture.holds, _MERGED)

    total = gathered(weight)
    share = np.where(total > 0, total, 1.0)
    mean = gathered(weight * off) / share
    square = gathered(weight * (mixture.deviation**2 + off**2)) / share
    within = np.sqrt(np.maximum(square - mean**2, 0.0))
    floor = 1e-9 * spread[:, None]
    return total, mean + middle[:, None], np.where(total > 0, np.maximum(within, floor), 1.0)
