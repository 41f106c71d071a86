"""Forecast and evidence of all mixture components on one sampling grid.

A component is a curve and a deviation. Let d be the differences of the binned samples to the last
bin, and s their unknown scale. Their covariance is s^2 (K + c c'), with K from the deviation and c
from the curve. Each deviation is factorised once per grid, and each curve is a rank-one update
(Sherman and Morrison), so that seven factors serve 189 components. The forecast is linear in d. The
evidence is |K + c c'|^(-1/2) (nu s0^2 + d' (K + c c')^-1 d)^(-(nu + m) / 2) with an inverse gamma
prior of s^2 (O'Hagan & Forster, Kendall's Advanced Theory of Statistics 2B, section 11.18).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.settling.baselines import log_law_weights
from palpate.settling.shapes import DEVIATIONS, N_CURVES, curve_values
from palpate.signal.transient import WAIT_S

#: Degrees of freedom of the prior of the scale of ln R (see `mixture.SCALE`).
SCALE_DEGREES = 4.0
#: Time offset in the logarithm of the walk, s: about the duration of the contact transient.
WALK_FROM_S = 0.2
#: Time constants of the decays with free amplitudes, s.
_LOOSE_S = np.geomspace(0.1, 100.0, 10)
#: Fast decays after contact: time constant (s) and standard deviation in units of the scale.
_FAST_S, _FAST_SD = np.array([(0.06, 3.0), (0.15, 2.0)]).T
#: Fewest samples of the log law's line after the wait; with fewer it is drawn through all samples.
_MIN_LINE_SAMPLES = 3
#: Keeps covariances positive definite if bins are close together.
_JITTER = 1e-9

N_DEVIATIONS = len(DEVIATIONS)
#: Deviation of each component; all curves of one deviation are adjacent.
DEVIATION_OF = np.repeat(np.arange(N_DEVIATIONS), N_CURVES)
_IS_OWN = np.arange(N_DEVIATIONS)[:, None] == DEVIATION_OF
#: Noise of one sample in each deviation, in units of the scale.
NOISE = np.array([d.noise for d in DEVIATIONS])
#: Variance of each covariance term in each deviation, shape (n_deviations, n_terms).
_VARIANCE = np.array(
    [[d.noise**2, d.walk**2, d.loose**2, d.fast] for d in DEVIATIONS], dtype=np.float64
)

#: Maximum number of bins; more bins do not improve the prediction.
MAX_BINS = 12
#: Below this time after the peak the bins have equal length (s).
LINEAR_BELOW_S = 0.1
#: Maximum number of independent noise samples. Real noise is coloured (mains, filters), and its
#: estimate does not improve in proportion to the sampling rate.
MAX_NOISE_SAMPLES = 12.0
#: If the total scatter (variance) exceeds the scatter of the second half by this factor, it is due
#: to the contact. The noise is then estimated from the second half only.
CONTACT_SCATTER = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conditionals:
    """The components evaluated on one grid; m is the number of differences."""

    #: Shape (n_bins, n_times). Each row averages the samples of one bin.
    averaging: FloatArray
    #: Number of independent noise samples, and degrees of freedom of the scale.
    noise_samples: float
    degrees: float
    #: Shape (m, n_deviations * m). Whitens the differences for each deviation.
    whitening: FloatArray
    #: Shape (m, n_components). Projects the differences on each whitened curve, divided by
    #: sqrt(1 + the curve's square) and multiplied by the square root of the handicap.
    along: FloatArray
    #: Shape (m, n_deviations). Forecast of each deviation.
    ahead: FloatArray
    #: Shape (n_deviations, n_components). Factor of the unexplained squares of a component, from
    #: the noise and the determinants: at least 1; 0 for all other deviations.
    handicap: FloatArray
    #: Shape (n_components,). Forecast per unit along the curve, and its variance per unexplained
    #: square.
    step: FloatArray
    variance: FloatArray
    #: At the recent rate per e-fold of time, the change is `pace` times the difference of the last
    #: bin to bin `pace_from`.
    pace_from: int
    pace: float
    #: Shape (n_times,). Weights of the samples in the log law's value at the horizon.
    log_law: FloatArray


def compute_conditionals(time_s: FloatArray, *, after_s: float, scaled: bool) -> Conditionals:
    """Compute the conditionals of a grid; results are cached.

    `time_s`, shape (n_times,): times of the samples after the origin, seconds; at least two.
    `after_s`: time of the value to predict, seconds after the origin.
    `scaled`: whether the values are ln R, whose scale is known roughly. The scale of other values
        is unknown.
    """
    return _compute_cached(time_s.tobytes(), after_s, scaled)


@lru_cache(maxsize=64)
def _compute_cached(time_bytes: bytes, after_s: float, scaled: bool) -> Conditionals:
    samples_s = np.frombuffer(time_bytes)
    averaging, count, time_s = log_bins(samples_s)
    last = time_s.size - 1
    pace_from = min(int(np.searchsorted(time_s, time_s[-1] / np.e)), last - 1)
    log_time = np.log(np.array([time_s[pace_from], time_s[-1], after_s]) + WALK_FROM_S)
    time_s = np.append(time_s, after_s)
    others = np.array([*range(last), last + 1], dtype=np.intp)
    curve = curve_values(time_s)
    curve = curve[others] - curve[last]
    # The factor includes the horizon: its last row is the horizon conditional on the samples.
    factor = np.linalg.cholesky(_covariances(count, time_s=time_s, others=others))
    whitening = np.asarray(np.linalg.inv(factor[:, :-1, :-1]), np.float64)
    ahead = factor[:, -1, :-1]
    whitened = whitening @ curve[:-1]
    root = np.sqrt(1 + np.einsum("kmc,kmc->kc", whitened, whitened))
    step = ((curve[-1] - (ahead[:, None] @ whitened)[:, 0]) / root).ravel()
    diagonal = np.diagonal(factor, axis1=1, axis2=2)
    log_weight = (-np.log(diagonal[:, :-1]).sum(axis=1)[:, None] - np.log(root)).ravel()
    variance = np.repeat(diagonal[:, -1] ** 2, N_CURVES) + step**2
    # Adjacent deviations share samples, so that about half of them are independent.
    noise_samples = min(max(samples_s.size - 2, 0) / 2, MAX_NOISE_SAMPLES)
    degrees = last + noise_samples + scaled * SCALE_DEGREES
    log_prior = log_weight - noise_samples * np.log(NOISE)[DEVIATION_OF]
    handicap = np.exp((log_prior.max() - log_prior) * (2 / degrees))
    is_line = samples_s >= WAIT_S - 1e-9
    if is_line.sum() < _MIN_LINE_SAMPLES:
        is_line[:] = True
    log_law = np.zeros(samples_s.size)
    log_law[is_line] = log_law_weights(samples_s[is_line], after_s=after_s, from_s=WALK_FROM_S)
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
        log_law=log_law,
    )


def _covariances(
    samples: FloatArray, *, time_s: FloatArray, others: NDArray[np.intp]
) -> FloatArray:
    """Return covariances of (other bins, value at horizon) minus the last bin, for scale 1."""
    last, count = samples.size - 1, others.size

    def outer(rows: FloatArray) -> FloatArray:
        difference = rows[others] - rows[last]
        return np.asarray(difference @ difference.T)

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
    """Divide sampling times after the peak into at most `MAX_BINS` equal bins of log time.

    `time_s`, shape (n_times,): seconds after the peak, starting at 0, strictly increasing.
    Returns a matrix that averages the samples of each bin, shape (n_bins, n_times), and the number
    of samples and the time of each bin. Empty bins are omitted.

    >>> _, count, _ = log_bins(np.arange(0.0, 3.0, 0.1))
    >>> count.astype(int).tolist()
    [1, 1, 1, 1, 1, 2, 2, 3, 5, 5, 8]
    """
    log_time = np.log(time_s + LINEAR_BELOW_S)
    if time_s.size <= MAX_BINS:
        label = np.arange(time_s.size)
    else:
        fraction = (log_time - log_time[0]) / (log_time[-1] - log_time[0])
        label = np.minimum((fraction * MAX_BINS).astype(np.intp), MAX_BINS - 1)
        label = np.concatenate([[0], (label[1:] > label[:-1]).cumsum()])
    count = np.bincount(label).astype(np.float64)
    averaging = (label == np.arange(count.size)[:, None]) / count[:, None]
    # The curves are nearly straight in log time, so that a bin's time is its mean log time.
    return averaging, count, np.exp(averaging @ log_time) - LINEAR_BELOW_S


def estimate_noise_variance(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Estimate the noise from the deviation of each sample from its neighbours' line.

    Returns the variance of one sample, shape (n_holds,); 0 for fewer than three samples.

    A straight line has no noise:

    >>> line = np.array([0.0, 0.1, 0.3, 0.4])
    >>> estimate_noise_variance(line, 10 * line[None]).round(9)
    array([0.])
    """
    if time_s.size < 3:
        return np.zeros(len(values))
    earlier_weight = (time_s[2:] - time_s[1:-1]) / (time_s[2:] - time_s[:-2])
    deviation = (
        values[:, 1:-1] - earlier_weight * values[:, :-2] - (1 - earlier_weight) * values[:, 2:]
    )
    square = np.square(deviation, out=deviation)
    square /= 1 + earlier_weight**2 + (1 - earlier_weight) ** 2
    variance, late = square.mean(axis=1), square[:, earlier_weight.size // 2 :].mean(axis=1)
    return np.asarray(np.where(variance > CONTACT_SCATTER * late, late, variance))
