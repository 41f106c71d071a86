"""The prior met with a sampling grid: linear forms that predict, quadratic forms that weigh.

Given a component of the prior up to one unknown scale s (with Jeffreys' prior 1/s) and a flat
offset, differences d of the binned samples to the last one have covariance s^2 S. The predicted
difference at the horizon is linear in d, the evidence is |S|^(-1/2) (d' S^-1 d)^(-m/2), and the
variance is proportional to d' S^-1 d (O'Hagan & Forster, Kendall's Advanced Theory of Statistics
2B, section 11.18). S depends on the grid alone: holds that share one share every factorisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.settling.bins import Bins, log_bins
from palpate.settling.prior import TIME_CONSTANTS_S, Prior
from palpate.settling.result import FloatArray

#: An average of many samples is no better than this share of one sample's variance: coloured noise.
NOISE_FLOOR = 0.02
#: While contact is made, until about then, a reading has no particular course.
JUMP_S = 0.12
#: Time added before the logarithm of the random walk, s.
WALK_FROM_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conditionals:
    """What the components of a prior make of one grid; m is the number of differences.

    Attributes
    ----------
    bins : Bins
        How samples are averaged first.
    whitening : ndarray, shape (n_components, m, m)
        Inverse Cholesky factors of S.
    forecast : ndarray, shape (n_components, m)
        Predicted change from the last bin to the horizon, per unit of each difference.
    log_det : ndarray, shape (n_components,)
        ln|S|.
    variance : ndarray, shape (n_components,)
        Variance of the forecast at unit scale.
    e_folds : float
        Log of the time at the horizon over the time of the last bin.
    """

    bins: Bins
    whitening: FloatArray
    forecast: FloatArray
    log_det: FloatArray
    variance: FloatArray
    e_folds: float


def conditionals(time_s: FloatArray, *, after_s: float, prior: Prior) -> Conditionals:
    """Work out, or recall, the conditionals of a grid.

    Parameters
    ----------
    time_s : ndarray, shape (n_times,)
        Seconds after the peak, starting at 0; at least two.
    after_s : float
        Time of the value to predict, seconds after the peak.
    prior : Prior
        Recalled by identity.
    """
    return _recall(time_s.tobytes(), after_s, _ByIdentity(prior))


class _ByIdentity:
    """A prior as a dictionary key: the object itself, not its arrays."""

    __slots__ = ("prior",)

    def __init__(self, prior: Prior) -> None:
        self.prior = prior

    def __hash__(self) -> int:
        return id(self.prior)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and other.prior is self.prior


@lru_cache(maxsize=64)
def _recall(time_bytes: bytes, after_s: float, key: _ByIdentity) -> Conditionals:
    time_s = np.frombuffer(time_bytes)
    bins = log_bins(time_s)
    covariance = _difference_covariance(bins, after_s=after_s, prior=key.prior)
    # Factorised whole: the last row of the factor is that of the horizon given the samples.
    factor = np.linalg.cholesky(covariance)
    whitening = np.linalg.inv(factor[:, :-1, :-1])
    forecast = factor[:, -1:, :-1] @ whitening
    diagonal = np.diagonal(factor, axis1=1, axis2=2)
    return Conditionals(
        bins=bins,
        whitening=whitening,
        forecast=np.asarray(forecast[:, 0]),
        log_det=2 * np.log(diagonal[:, :-1]).sum(axis=1),
        variance=diagonal[:, -1] ** 2,
        e_folds=float(np.log((after_s + WALK_FROM_S) / (bins.time_s[-1] + WALK_FROM_S))),
    )


def _difference_covariance(bins: Bins, *, after_s: float, prior: Prior) -> FloatArray:
    """Return the covariance of (other bins, value at the horizon) less the last bin, unit scale."""
    time = np.append(bins.time_s, after_s)
    last = bins.time_s.size - 1
    others = np.delete(np.arange(time.size), last)
    decays = np.exp(-time[:, None] / TIME_CONSTANTS_S)
    decays = decays[others] - decays[last]
    curve = prior.mean_weights @ decays.T
    log_time = np.log(time + WALK_FROM_S)
    steps = log_time[others] - log_time[last]
    noise = 1 / bins.count + NOISE_FLOOR
    jump = 1 / (1 + (bins.time_s / JUMP_S) ** 6) ** 2
    # Each is a matrix of its own times a variance of the prior: one product adds them all up.
    terms = np.empty((TIME_CONSTANTS_S.size + 3, others.size, others.size))
    np.multiply(decays.T[:, :, None], decays.T[:, None, :], out=terms[:-3])
    walk = np.minimum(np.abs(steps)[:, None], np.abs(steps))
    np.multiply(walk, steps[:, None] * steps > 0, out=terms[-3])
    terms[-2], terms[-1] = noise[-1], jump[-1]
    diagonal = np.arange(last)
    terms[-2, diagonal, diagonal] += noise[:-1]
    terms[-1, diagonal, diagonal] += jump[:-1]
    covariance = _variances(_ByIdentity(prior)) @ terms.reshape(len(terms), -1)
    squares: FloatArray = curve[:, :, None] * curve[:, None, :]
    return squares + covariance.reshape(squares.shape)


@lru_cache(maxsize=8)
def _variances(key: _ByIdentity) -> FloatArray:
    """Return what each term of the covariance counts for, shape (n_components, n_terms)."""
    prior = key.prior
    return np.column_stack([prior.weight_variance, prior.walk**2, prior.noise**2, prior.contact**2])
