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
SHAPE_DOUBT = 0.08
#: Components that weigh less than this share of the heaviest one change no digit that matters.
LIGHTEST = 1e-3
#: Holds whose components are weighed at once: the arrays then stay within a processor's own cache.
AT_ONCE = 32
#: Components with nearly the same forecast are merged before quantiles are sought: bins across so
#: many standard deviations to either side.
_MERGED, _SPAN = 12, 2.0
#: Where the probability is worked out, standard deviations from the mean.
_PLACES = np.array([-3.0, -1.8, -1.0, -0.4, 0.0, 0.4, 1.0, 1.8, 3.0])
#: A probability that is no other than 0 or 1, and a variance that is none.
_RAREST = 1e-9
#: How far beyond the places a quantile may lie, and how far it is mended.
_BEYOND, _MENDED = (-6.0, 6.0), 0.3
_TINY = float(np.finfo(float).tiny)


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
        return np.asarray(np.bincount(self.hold, weights=terms, minlength=self.holds), np.float64)


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
    noise, samples = scatter
    degrees = binned.shape[1] - 1 + samples + scaled * SCALE_DEGREES
    seen = binned[:, :-1] - binned[:, -1:]
    whitened = np.swapaxes(forms.whitening @ seen.T, 1, 2)
    squares = (whitened**2).sum(axis=2) + scaled * SCALE_DEGREES * SCALE**2
    squares += samples * noise / NOISE[:, None] ** 2 + _TINY
    # A weight is handicap x left to the power of -degrees / 2: whether it counts is told without
    # taking a logarithm.
    log_prior = forms.log_weight + log_odds - samples * np.log(NOISE)[:, None]
    handicap = np.exp((log_prior.max() - log_prior) * (2 / degrees))
    parts = []
    for first in range(0, len(binned), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        found = _heaviest(
            whitened[:, part] @ forms.curves,
            squares[:, part],
            handicap=handicap,
            heaviest=lightest ** (-2 / degrees),
        )
        parts.append((found[0] + first, *found[1:]))
    hold, component, along, left, over = map(np.concatenate, zip(*parts, strict=True))
    weight = over ** (-degrees / 2)
    weight /= np.bincount(hold, weights=weight)[hold]
    ahead = (whitened @ forms.ahead[:, :, None])[component // log_odds.shape[1], hold, 0]
    variance = (forms.variance / handicap / max(degrees - 2, 1)).ravel()[component]
    return Mixture(
        holds=len(binned),
        hold=hold,
        component=component,
        weight=weight,
        forecast=ahead + forms.step.ravel()[component] * along,
        deviation=np.sqrt(left * variance),
    )


def _heaviest(
    along: FloatArray, squares: FloatArray, *, handicap: FloatArray, heaviest: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray, FloatArray, FloatArray]:
    """Return the components that matter of some holds.

    Parameters
    ----------
    along : ndarray, shape (n_deviations, n_holds, n_curves)
        Products of the whitened differences with the curves.
    squares : ndarray, shape (n_deviations, n_holds)
        Their own squares and those of the prior.
    handicap : ndarray, shape (n_deviations, n_curves)
        By how much more must be explained, for the odds and the determinants.
    heaviest : float
        What is left unexplained may be so many times the least.

    Returns
    -------
    tuple of ndarray, shape (n_kept,)
        Hold, component, product, what is left unexplained, and that over the least of the hold.
    """
    left = np.square(along)
    np.subtract(squares[:, :, None], left, out=left)
    np.maximum(left, 1e-12 * squares[:, :, None], out=left)
    left *= handicap[:, None]
    least = left.min(axis=(0, 2))
    kept = np.flatnonzero(left <= (least * heaviest)[:, None])
    row, curve = np.divmod(kept, left.shape[2])
    deviation, hold = np.divmod(row, left.shape[1])
    kept_left = left.ravel()[kept]
    component = deviation * left.shape[2] + curve
    return hold, component, along.ravel()[kept], kept_left, kept_left / least[hold]


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
    ...     forecast=np.array([2.0, 4.0]), deviation=np.array([0.5, 0.5]),
    ... )
    >>> quantiles(two, np.array([0.05, 0.5])).round(2).tolist()
    [[1.36], [3.0]]
    """
    merged, middle, spread = _merge(mixture)
    # As normal variables the probabilities at a few places are nearly a straight line: what lies
    # between is interpolated, and one Newton step on that line mends it.
    z = ndtri(np.clip(_below(_PLACES[None], merged), _RAREST, 1 - _RAREST))
    wanted = ndtri(shares)
    after = np.clip((z[:, None] < wanted[:, None]).sum(axis=2), 1, _PLACES.size - 1)
    rows = np.arange(len(z))[:, None]
    z0, z1 = z[rows, after - 1], z[rows, after]
    slope = (_PLACES[after] - _PLACES[after - 1]) / np.maximum(z1 - z0, _RAREST)
    at = _PLACES[after - 1] + np.clip((wanted - z0) * slope, *_BEYOND)
    z = ndtri(np.clip(_below(at, merged), _RAREST, 1 - _RAREST))
    at += np.clip((wanted - z) * slope, -_MENDED, _MENDED)
    return np.asarray((middle[:, None] + spread[:, None] * np.sort(at, axis=1)).T)


def _below(places: FloatArray, merged: FloatArray) -> FloatArray:
    """Return the probability below places of each hold, in units of `_merge`."""
    weight, mean, deviation = merged
    z = (places[:, :, None] - mean[:, None]) / deviation[:, None]
    return np.asarray((ndtr(z) @ weight[:, :, None])[:, :, 0])


def _merge(mixture: Mixture) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mixture with like forecasts merged, and the mean and spread that are its unit.

    The first has shape (3, n_holds, n_merged): weights, means and deviations.
    """
    weight, middle = mixture.weight, mixture.sums(mixture.weight * mixture.forecast)
    off = mixture.forecast - middle[mixture.hold]
    spread = np.sqrt(mixture.sums(weight * (mixture.deviation**2 + off**2)))
    unit = np.maximum(spread, _TINY)[mixture.hold]
    off, variance = off / unit, (mixture.deviation / unit) ** 2
    place = np.clip((off + _SPAN) * (_MERGED / (2 * _SPAN)), 0, _MERGED - 1).astype(np.intp)
    place += mixture.hold * _MERGED
    total, first, second = (
        np.bincount(place, weights=terms, minlength=mixture.holds * _MERGED)
        for terms in (weight, weight * off, weight * (variance + off**2))
    )
    share = np.maximum(total, _TINY)
    mean = first / share
    deviation = np.sqrt(np.maximum(second / share - mean**2, _RAREST))
    merged = np.stack([total, mean, deviation]).reshape(3, mixture.holds, _MERGED)
    return merged, middle, spread
