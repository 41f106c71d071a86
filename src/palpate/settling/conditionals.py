"""Forecast and evidence of all mixture components on one sampling grid.

A component is a curve and a deviation. Let d be the differences of the binned samples to the last
bin, and s their unknown scale. Their covariance is s^2 (K + c c'), with K from the deviation and c
from the curve. Each deviation is factorised once per grid, and each curve is a rank-one update
(Sherman and Morrison), so that four factors serve 80 components. The forecast is linear in d. The
evidence is |K + c c'|^(-1/2) (nu s0^2 + d' (K + c c')^-1 d)^(-(nu + m) / 2) with an inverse gamma
prior of s^2 (O'Hagan & Forster, Kendall's Advanced Theory of Statistics 2B, section 11.18).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.settling.baselines import log_law_weights
from palpate.settling.shapes import LOOSE, NOISE, WALK, curve_values
from palpate.signal.transient import WAIT_S

#: Prior scale of the change of ln R from 0.3 to 20 s, and its degrees of freedom. Sheets and soft
#: materials creep by a tenth to a half (median drops of five real materials: .08 to .4).
SCALE, SCALE_DEGREES = 0.18, 4.0
#: Time offset in the logarithm of the walk, s: about the duration of the contact transient.
WALK_FROM_S = 0.2
#: Rates of the decays with free amplitudes, 1/s.
_LOOSE_RATE = -1 / np.geomspace(0.1, 100.0, 10)
#: Fewest samples of the log law's line after the wait; with fewer it is drawn through all samples.
_MIN_LINE_SAMPLES = 3
#: Keep covariances positive definite if bins are close together, and the unexplained squares of a
#: constant hold positive after rounding.
_JITTER, _TINY = 1e-9, 1e-290

N_DEVIATIONS = NOISE.size
#: Variances of the deviations, shape (n_deviations, 3).
_VARIANCES = np.square(np.stack((NOISE, WALK, LOOSE), axis=1))
_LOG_NOISE = np.log(NOISE)

#: Maximum number of bins; more bins do not improve the prediction.
MAX_BINS = 12
_EDGES = np.arange(MAX_BINS + 1)
#: Below this time after the peak the bins have equal length (s).
LINEAR_BELOW_S = 0.1
#: Maximum number of independent noise samples. Real noise is coloured (mains, filters), and its
#: estimate does not improve in proportion to the sampling rate.
MAX_NOISE_SAMPLES = 12.0
#: If the total scatter (variance) exceeds the scatter of the second half by this factor, it is due
#: to the contact. The noise is then estimated from the second half only.
CONTACT_SCATTER = 10.0

#: See `weigh_noise`.
NoiseWeights: TypeAlias = tuple[FloatArray, FloatArray]


class Conditionals(NamedTuple):
    """The components evaluated on one grid; m is the number of differences."""

    #: Shape (m + 1,). First sample of each bin, and number of samples in it.
    starts: NDArray[np.intp]
    sizes: FloatArray
    #: Weights for `estimate_noise`.
    noise_weights: NoiseWeights
    #: Unexplained squares of each deviation from the prior of the scale, and per noise variance of
    #: a sample, shape (n_deviations, 1); degrees of freedom of the scale.
    prior_squares: float
    noise_squares: FloatArray
    degrees: float
    #: Shape (n_deviations, m + 1, m). Whitens the differences. The last row is the change from the
    #: horizon to the last bin that the deviation predicts.
    whitening: FloatArray
    #: Shape (n_deviations, n_curves, m). Whitened curves, divided by sqrt(1 + their square).
    along: FloatArray
    #: Shape (n_components,). Forecast of a component per projection on its curve.
    gain: FloatArray
    #: Shape (n_deviations, n_curves, 1). Factor of the unexplained squares of a component in its
    #: weight, from the noise and the determinants.
    handicap: FloatArray
    #: Shape (n_components,). Variance of a component's forecast per unexplained square, divided by
    #: the handicap.
    variance: FloatArray
    #: At the recent rate per e-fold of time, the change is `pace` times the difference of the last
    #: bin to bin `pace_from`.
    pace_from: int
    pace: float


@lru_cache(maxsize=64)
def compute_conditionals(time_bytes: bytes, *, after_s: float, scaled: bool) -> Conditionals:
    """Compute the conditionals of a grid; results are cached.

    `time_bytes`: bytes of the times of the samples after the origin, seconds; at least two.
    `after_s`: time of the value to predict, seconds after the origin.
    `scaled`: whether the values are ln R, whose scale is known roughly. The scale of other values
        is unknown.
    """
    samples_s = np.frombuffer(time_bytes)
    starts, count, time_s = log_bins(samples_s)
    m = starts.size - 1
    # The horizon is between the other bins and the last bin, to which differences are taken.
    points_s = np.concatenate((time_s[:-1], (after_s,), time_s[-1:]))
    curves = curve_values(points_s)
    curves = curves[:-1] - curves[-1]
    log_time = np.log(points_s + WALK_FROM_S)
    covariances = _covariances(count, points_s=points_s, log_time=log_time)
    # The factor includes the horizon: its last row is the horizon conditional on the samples.
    factor = np.linalg.cholesky(covariances)
    inverse: FloatArray = np.linalg.inv(factor)
    diagonal = factor.diagonal(axis1=1, axis2=2)
    spread = diagonal[:, m:]
    inverse[:, m] *= spread
    whitened = inverse @ curves
    along = whitened[:, :m]
    square = 1 + np.add.reduce(along * along, axis=1)
    norm = np.sqrt(square)
    gain = whitened[:, m] / norm
    # Adjacent deviations share samples, so that about half of them are independent.
    noise_samples = min(max(samples_s.size - 2, 0) / 2, MAX_NOISE_SAMPLES)
    degrees = m + noise_samples + scaled * SCALE_DEGREES
    log_size = np.add.reduce(np.log(diagonal[:, :m]), axis=1) + noise_samples * _LOG_NOISE
    handicap = np.exp((2 / degrees) * (np.log(norm) + log_size[:, None]))
    variance = (spread * spread + gain * gain) / (max(degrees - 2, 1) * handicap)
    pace_from = min(int(time_s.searchsorted(time_s[-1] / math.e)), m - 1)
    now = log_time[-1]
    return Conditionals(
        starts=starts,
        sizes=count,
        noise_weights=weigh_noise(samples_s),
        prior_squares=scaled * SCALE_DEGREES * SCALE**2 + _TINY,
        noise_squares=noise_samples / _VARIANCES[:, :1],
        degrees=degrees,
        whitening=inverse[:, :, :m],
        along=(along / norm[:, None]).transpose(0, 2, 1),
        gain=gain.ravel(),
        handicap=handicap[:, :, None],
        variance=variance.ravel(),
        pace_from=pace_from,
        pace=float((log_time[m] - now) / (now - log_time[pace_from])),
    )


def _covariances(count: FloatArray, *, points_s: FloatArray, log_time: FloatArray) -> FloatArray:
    """Return covariances of (other bins, value at horizon) minus the last bin, for scale 1."""
    m = count.size - 1
    noise, walk, loose = parts = np.empty((3, m + 1, m + 1))
    noise[:] = 1 / count[m]
    noise.reshape(-1)[: -1 : m + 2] += 1 / count[:m]
    distance = np.abs(log_time[:-1] - log_time[-1])
    np.minimum(distance[:, None], distance, out=walk)
    # The walk before the last bin and the walk after it are independent.
    walk[m, :m] = walk[:m, m] = 0.0
    decays = np.exp(points_s[:, None] * _LOOSE_RATE)
    decays = decays[:-1] - decays[-1]
    np.dot(decays, decays.T, out=loose)
    covariances = _VARIANCES.dot(parts.reshape(3, -1))
    covariances[:, :: m + 2] += _JITTER
    return np.asarray(covariances.reshape(N_DEVIATIONS, m + 1, m + 1))


@lru_cache(maxsize=64)
def weigh_line(time_bytes: bytes, after_s: float) -> FloatArray:
    """Return the weights of the samples in the log law's value; see `compute_conditionals`."""
    samples_s = np.frombuffer(time_bytes)
    first = int(samples_s.searchsorted(WAIT_S - 1e-9))
    if samples_s.size - first < _MIN_LINE_SAMPLES:
        first = 0
    weights = np.zeros(samples_s.size)
    weights[first:] = log_law_weights(samples_s[first:], after_s=after_s, from_s=WALK_FROM_S)
    return weights


def log_bins(time_s: FloatArray) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """Divide sampling times after the peak into at most `MAX_BINS` equal bins of log time.

    `time_s`, shape (n_times,): seconds after the peak, starting at 0, strictly increasing.
    Returns the first sample, the number of samples and the time of each bin. Empty bins are
    omitted.

    >>> _, count, _ = log_bins(np.arange(0.0, 3.0, 0.1))
    >>> count.astype(int).tolist()
    [1, 1, 1, 1, 1, 2, 2, 3, 5, 5, 8]
    """
    log_time = np.log(time_s + LINEAR_BELOW_S)
    edges = _EDGES[: time_s.size + 1]
    if time_s.size > MAX_BINS:
        width = (log_time[-1] - log_time[0]) / MAX_BINS
        edges = log_time.searchsorted(log_time[0] + width * _EDGES)
        edges[-1] = time_s.size
    size = edges[1:] - edges[:-1]
    [filled] = size.nonzero()
    starts, count = edges.take(filled), size.take(filled).astype(np.float64)
    # The curves are nearly straight in log time, so that a bin's time is its mean log time.
    mean = np.add.reduceat(log_time, starts) / count
    return starts, count, np.exp(mean) - LINEAR_BELOW_S


def weigh_noise(time_s: FloatArray) -> NoiseWeights:
    """Return weights for `estimate_noise`.

    These are the weight of the earlier neighbour of each sample but the first and the last, and
    the factor of its squared deviation.
    """
    step_s = time_s[1:] - time_s[:-1]
    earlier = step_s[1:] / (step_s[1:] + step_s[:-1])
    return earlier, 0.5 / (1 - earlier * (1 - earlier))


def estimate_noise(weights: NoiseWeights, values: FloatArray) -> FloatArray:
    """Estimate the noise from the deviation of each sample from its neighbours' line.

    Returns the variance of one sample, shape (n_holds,); 0 for fewer than three samples.

    A straight line has no noise:

    >>> line = np.array([0.0, 0.1, 0.3, 0.4])
    >>> estimate_noise(weigh_noise(line), 10 * line[None]).round(9)
    array([0.])
    """
    earlier, factor = weights
    count = earlier.size
    later = values[:, 2:]
    square = values[:, 1:-1] - later + earlier * (later - values[:, :count])
    square *= square
    square *= factor
    late = np.add.reduce(square[:, count // 2 :], axis=1) / max(count - count // 2, 1)
    variance = np.add.reduce(square, axis=1) / max(count, 1)
    return np.asarray(np.where(variance > CONTACT_SCATTER * late, late, variance))
