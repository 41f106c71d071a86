"""Averages over stretches of a hold that grow geometrically, and what they hide: the noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.settling.result import FloatArray

#: More stretches than this sharpen no prediction, they only cost.
MOST_BINS = 12
#: Below this time after the peak, stretches stop shrinking (s).
LINEAR_BELOW_S = 0.1
#: Scatter within the stretches counts as at most this many independent samples: real noise is
#: coloured (mains, filters), and a thousand samples a second don't know it a thousand times better.
MOST_NOISE_SAMPLES = 12.0
#: Scatter this much larger (variance) over the whole than over the later half is no noise: contact
#: was being made. The later half alone then tells the noise.
CONTACT_SCATTER = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bins:
    """Stretches of a sampling grid."""

    #: Shape (n_bins, n_times). Rows that average the samples of one stretch each.
    averaging: FloatArray
    #: Shape (n_bins,). Time of each average, seconds after the peak.
    time_s: FloatArray
    #: Shape (n_bins,). Samples in each.
    count: FloatArray


def log_bins(time_s: FloatArray) -> Bins:
    """Divide sampling times after the peak into stretches of equal length in log time.

    Parameters
    ----------
    time_s : ndarray, shape (n_times,)
        Seconds after the peak, starting at 0, strictly increasing.

    Returns
    -------
    Bins
        At most `MOST_BINS`; empty stretches are left out.

    Examples
    --------
    >>> bins = log_bins(np.arange(0.0, 3.0, 0.1))
    >>> bins.count.astype(int).tolist()
    [1, 1, 1, 1, 1, 2, 2, 3, 5, 5, 8]
    """
    n_times = time_s.size
    log_time = np.log(time_s + LINEAR_BELOW_S)
    if n_times <= MOST_BINS:
        label = np.arange(n_times)
    else:
        share = (log_time - log_time[0]) / (log_time[-1] - log_time[0])
        label = np.minimum((share * MOST_BINS).astype(np.intp), MOST_BINS - 1)
        label = np.cumsum(np.diff(label, prepend=label[0]) > 0)
    count = np.bincount(label).astype(np.float64)
    averaging = np.zeros((count.size, n_times))
    averaging[label, np.arange(n_times)] = 1.0 / count[label]
    # Averaging a curve that is nearly straight in log time: its time is the mean log time.
    time = np.exp(averaging @ log_time) - LINEAR_BELOW_S
    return Bins(averaging=averaging, time_s=time, count=count)


def noise_scatter(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, float]:
    """Measure the noise by how far each sample lies from the line between its neighbours.

    Parameters
    ----------
    time_s : ndarray, shape (n_times,)
        Sampling times.
    values : ndarray, shape (n_holds, n_times)
        Samples.

    Returns
    -------
    variance : ndarray, shape (n_holds,)
        Noise variance of one sample; zero where there are fewer than three.
    samples : float
        The number of independent samples that it counts for.

    Examples
    --------
    A straight line has none:

    >>> noise_scatter(np.array([0.0, 0.1, 0.3, 0.4]), np.array([[0.0, 1.0, 3.0, 4.0]]))[0].round(9)
    array([0.])
    """
    n_times = time_s.size
    if n_times < 3:
        return np.zeros(len(values)), 0.0
    before, here, after, means = _neighbours(time_s.tobytes())
    off = here * values[:, 1:-1]
    off -= before * values[:, :-2]
    off -= after * values[:, 2:]
    variance, late = (np.square(off, out=off) @ means).T
    variance = np.where(variance > CONTACT_SCATTER * late, late, variance)
    # Neighbouring deviations share samples: about half of them are independent.
    return variance, min((n_times - 2) / 2, MOST_NOISE_SAMPLES)


@lru_cache(maxsize=64)
def _neighbours(time_bytes: bytes) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return what samples and their neighbours count for in a deviation of unit variance.

    Last come the weights of all squares, and of those of the later half, shape (n_times - 2, 2).
    """
    time_s = np.frombuffer(time_bytes)
    left = (time_s[2:] - time_s[1:-1]) / (time_s[2:] - time_s[:-2])
    unit = np.sqrt(1 + left**2 + (1 - left) ** 2)
    late = np.arange(left.size) >= left.size // 2
    means = np.stack([np.full(left.size, 1 / left.size), late / late.sum()], axis=1)
    return left / unit, 1 / unit, (1 - left) / unit, means
