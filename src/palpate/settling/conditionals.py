"""The shapes on a sampling grid: linear forms that forecast, quadratic forms that weigh.

A component is a curve and a deviation. Up to one unknown scale s, the differences d of the binned
samples to the last one have covariance s^2 (K + c c'), with K of the deviation and c of the curve.
Deviations are factorised once for a grid, and each curve is a rank-one update (Sherman and
Morrison), so seven factors serve 189 components. The forecast is linear in d,
the evidence is |K + c c'|^(-1/2) (nu s0^2 + d' (K + c c')^-1 d)^(-(nu + m) / 2) under an inverse
gamma prior of s^2 (O'Hagan & Forster, Kendall's Advanced Theory of Statistics 2B, section 11.18).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.settling.shapes import DEVIATIONS, N_CURVES, curve_values

#: Degrees of freedom of the prior of the scale of ln R (see `mixture.SCALE`).
SCALE_DEGREES = 4.0
#: Time added before the logarithm of the walk, s: about the length of the contact transient.
WALK_FROM_S = 0.2
#: Time constants of the decays whose amplitudes are loose, s.
_LOOSE_S = np.geomspace(0.1, 100.0, 10)
#: What contact adds, in units of the scale: fast decays (time constant in s, sd).
_FAST_S, _FAST_SD = np.array([(0.06, 3.0), (0.15, 2.0)]).T
#: Keeps covariances positive definite where bins lie close together.
_JITTER = 1e-9

N_DEVIATIONS = len(DEVIATIONS)
#: Which deviation each component has: they are counted deviation by deviation.
DEVIATION_OF = np.repeat(np.arange(N_DEVIATIONS), N_CURVES)
_IS_OWN = np.arange(N_DEVIATIONS)[:, None] == DEVIATION_OF
#: Noise of one sample in each deviation, in units of the scale.
NOISE = np.array([d.noise for d in DEVIATIONS])
#: What each term of the covariance counts for in each deviation, shape (n_deviations, n_terms).
_VARIANCE = np.array(
    [[d.noise**2, d.walk**2, d.loose**2, d.fast] for d in DEVIATIONS], dtype=np.float64
)

#: More bins than this sharpen no prediction, they only cost.
MOST_BINS = 12
#: Below this time after the peak, bins stop shrinking (s).
LINEAR_BELOW_S = 0.1
#: Scatter within the bins counts as at most this many independent samples: real noise is coloured
#: (mains, filters), and a thousand samples a second don't know it a thousand times better.
MOST_NOISE_SAMPLES = 12.0
#: Scatter this much larger (variance) over the whole than over the later half is no noise: contact
#: was being made. The later half alone then gives the noise.
CONTACT_SCATTER = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conditionals:
    """The components evaluated on one grid; m is the number of differences."""

    #: Shape (n_bins, n_times). Averages the samples of one bin each.
    averaging: FloatArray
    #: Independent samples of noise, and degrees of freedom of the scale.
    noise_samples: float
    degrees: float
    #: Factors of differences, m rows each: whitened by each deviation, shape (m, n_deviations * m);
    #: along each whitened curve divided by sqrt(1 + its square) and times the root of the handicap,
    #: shape (m, n_components); and forecast by each deviation, shape (m, n_deviations).
    whitening: FloatArray
    along: FloatArray
    ahead: FloatArray
    #: Shape (n_deviations, n_components). What multiplies the unexplained squares of a component,
    #: for the noise and the determinants: at least 1; 0 outside of its own deviation.
    handicap: FloatArray
    #: Shape (n_components,). Forecast per unit along the curve, and its variance per unit left.
    step: FloatArray
    variance: FloatArray
    #: The recent pace per e-fold of time would bring a change of `pace` times the difference of the
    #: last bin to this one.
    pace_from: int
    pace: float


def conditionals(
    time_s: FloatArray, *, after_s: float, loading_s: float, scaled: bool
) -> Conditionals:
    """Work out, or recall, the conditionals of a grid.

    `time_s`, shape (n_times,): seconds after the origin of the samples to use; at least two.
    `after_s`: time of the value to predict, seconds after the origin.
    `loading_s`: how long loading took before the origin; 0 where it is not known.
    `scaled`: whether the values are ln R, whose scale is known roughly; of other units nothing is.
    """
    return _recall(time_s.tobytes(), after_s, loading_s, scaled)


@lru_cache(maxsize=64)
def _recall(time_bytes: bytes, after_s: float, loading_s: float, scaled: bool) -> Conditionals:
    samples_s = np.frombuffer(time_bytes)
    averaging, count, time_s = log_bins(samples_s)
    last = time_s.size - 1
    pace_from = min(int(np.searchsorted(time_s, time_s[-1] / np.e)), last - 1)
    log_time = np.log(np.array([time_s[pace_from], time_s[-1], after_s]) + WALK_FROM_S)
    time_s = np.append(time_s, after_s)
    others = np.array([*range(last), last + 1], dtype=np.intp)
    curve = curve_values(time_s, loading_s=loading_s)
    curve = curve[others] - curve[last]
    # Factorised whole: the last row of the factor is that of the horizon given the samples.
    factor = np.linalg.cholesky(_covariances(count, time_s=time_s, others=others))
    whitening = np.asarray(np.linalg.inv(factor[:, :-1, :-1]), np.float64)
    ahead = factor[:, -1, :-1]
    whitened = whitening @ curve[:-1]
    root = np.sqrt(1 + np.einsum("kmc,kmc->kc", whitened, whitened))
    step = ((curve[-1] - (ahead[:, None] @ whitened)[:, 0]) / root).ravel()
    diagonal = np.diagonal(factor, axis1=1, axis2=2)
    log_weight = (-np.log(diagonal[:, :-1]).sum(axis=1)[:, None] - np.log(root)).ravel()
    variance = np.repeat(diagonal[:, -1] ** 2, N_CURVES) + step**2
    # Neighbouring deviations share samples: about half of them are independent.
    noise_samples = min(max(samples_s.size - 2, 0) / 2, MOST_NOISE_SAMPLES)
    degrees = last + noise_samples + scaled * SCALE_DEGREES
    log_prior = log_weight - noise_samples * np.log(NOISE)[DEVIATION_OF]
    handicap = np.exp((log_prior.max() - log_prior) * (2 / degrees))
    back = whitening.transpose(0, 2, 1)
    whitening_back, along, ahead_of = (
        np.ascontiguousarray(part.transpose(1, 0, 2)).reshape(last, -1)
        for part in (back, back @ (whitened / root[:, None]), back @ ahead[:, :, None])
    )
    return Conditionals(
        averaging=averaging,
        noise_samples=noise_samples,
        degrees=degrees,
        whitening=whitening_back,
        along=along * np.sqrt(handicap),
        ahead=ahead_of,
        handicap=np.where(_IS_OWN, handicap, 0.0),
        step=step / np.sqrt(handicap),
        variance=variance / handicap / max(degrees - 2, 1),
        pace_from=pace_from,
        pace=float((log_time[2] - log_time[1]) / (log_time[1] - log_time[0])),
    )


def _covariances(
    samples: FloatArray, *, time_s: FloatArray, others: NDArray[np.intp]
) -> FloatArray:
    """Return covariances of (other bins, value at the horizon) less the last bin, unit scale."""
    last, count = samples.size - 1, others.size

    def outer(rows: FloatArray) -> FloatArray:
        moved = rows[others] - rows[last]
        return np.asarray(moved @ moved.T)

    noise = np.append(1 / samples, 0.0)
    log_time = np.log(time_s + WALK_FROM_S)
    steps = log_time[others] - log_time[last]
    terms = np.empty((_VARIANCE.shape[1], count, count))
    terms[0] = noise[last] + np.diag(noise[others])
    terms[1] = np.minimum(np.abs(steps)[:, None], np.abs(steps)) * (steps[:, None] * steps > 0)
    terms[2] = outer(np.exp(-time_s[:, None] / _LOOSE_S))
    terms[3] = outer(_FAST_SD * np.exp(-time_s[:, None] / _FAST_S))
    covariance = _VARIANCE @ terms.reshape(len(terms), -1)
    return np.asarray(covariance.reshape(-1, count, count) + _JITTER * np.eye(count))


def log_bins(time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Divide sampling times after the peak into bins of equal length in log time.

    `time_s`, shape (n_times,): seconds after the peak, starting at 0, strictly increasing.
    Returns rows that average the samples of one bin each, shape (n_bins, n_times), and the number
    of samples and the time of each bin. At most `MOST_BINS`; empty bins are left out.

    >>> _, count, _ = log_bins(np.arange(0.0, 3.0, 0.1))
    >>> count.astype(int).tolist()
    [1, 1, 1, 1, 1, 2, 2, 3, 5, 5, 8]
    """
    log_time = np.log(time_s + LINEAR_BELOW_S)
    if time_s.size <= MOST_BINS:
        label = np.arange(time_s.size)
    else:
        share = (log_time - log_time[0]) / (log_time[-1] - log_time[0])
        label = np.minimum((share * MOST_BINS).astype(np.intp), MOST_BINS - 1)
        label = np.concatenate([[0], (label[1:] > label[:-1]).cumsum()])
    count = np.bincount(label).astype(np.float64)
    averaging = (label == np.arange(count.size)[:, None]) / count[:, None]
    # Averaging a curve that is nearly straight in log time: its time is the mean log time.
    return averaging, count, np.exp(averaging @ log_time) - LINEAR_BELOW_S


def noise_variance(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Measure the noise by how far each sample lies from the line between its neighbours.

    Returns the variance of one sample, shape (n_holds,); zero of fewer than three samples.

    A straight line has none:

    >>> noise_variance(np.array([0.0, 0.1, 0.3, 0.4]), np.array([[0.0, 1.0, 3.0, 4.0]])).round(9)
    array([0.])
    """
    if time_s.size < 3:
        return np.zeros(len(values))
    left = (time_s[2:] - time_s[1:-1]) / (time_s[2:] - time_s[:-2])
    off = values[:, 1:-1] - left * values[:, :-2] - (1 - left) * values[:, 2:]
    square = np.square(off, out=off)
    square /= 1 + left**2 + (1 - left) ** 2
    variance, late = square.mean(axis=1), square[:, left.size // 2 :].mean(axis=1)
    return np.asarray(np.where(variance > CONTACT_SCATTER * late, late, variance))
