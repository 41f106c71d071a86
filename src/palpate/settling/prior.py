"""What is known of a hold before its first sample: how materials of this kind relax.

A hold is a sum of decays whose time constants are spread evenly over log time (such a sum is a
smoothed logarithm), a fast process right after contact, at times one dominant decay of a second or
so, a slow random walk in log time and noise. All amplitudes are relative to one scale, the hold's
own, and the offset is left free: nothing here knows the unit of the values or where their zero is.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from palpate.settling.result import FloatArray

#: Time constants, s: from one sample of a fast sensor to creep far beyond any horizon.
TIME_CONSTANTS_S = np.geomspace(0.05, 400.0, 18)
TIME_CONSTANTS_S.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """A mixture of Gaussian priors on the shape of a hold; shapes are (n_components, ...).

    Attributes
    ----------
    mean_weights : ndarray, shape (n_components, n_time_constants)
        Amplitudes of the decays of the mean curve, which falls by 1 between 0.3 and 20 s.
    weight_variance : ndarray, shape (n_components, n_time_constants)
        Variance of each amplitude about its mean.
    walk : ndarray, shape (n_components,)
        Standard deviation that the random walk gains per e-fold of time.
    noise : ndarray, shape (n_components,)
        Standard deviation of one sample.
    log_weight : ndarray, shape (n_components,)
        Logarithm of the prior probability.
    """

    mean_weights: FloatArray
    weight_variance: FloatArray
    walk: FloatArray
    noise: FloatArray
    log_weight: FloatArray

    def reweighted(self, log_weight: FloatArray) -> Prior:
        """Return the same components with other probabilities."""
        return replace(self, log_weight=log_weight)


def default_prior() -> Prior:
    """Return the prior used without calibration holds."""
    tau = TIME_CONSTANTS_S
    mean_weights, variance, walks, noises = [], [], [], []
    for start_s, spread, walk, noise, mode in itertools.product(
        (0.05, 0.3, 1.0, 3.0), (0.2, 0.5, 1.0), (0.02, 0.06, 0.15), (0.003, 0.012, 0.05), (0.0, 0.5)
    ):
        weights = np.exp(-start_s / tau)
        weights /= weights @ (np.exp(-0.3 / tau) - np.exp(-20.0 / tau))
        free_mode = mode**2 / 1.5 * np.exp(-2 * np.log(tau / 2.0) ** 2)
        fast = 4.0 * (tau <= 0.12)
        mean_weights.append(weights)
        variance.append((spread * weights) ** 2 + free_mode + fast)
        walks.append(walk)
        noises.append(noise)
    return Prior(
        mean_weights=np.array(mean_weights),
        weight_variance=np.array(variance),
        walk=np.array(walks),
        noise=np.array(noises),
        log_weight=np.zeros(len(walks)),
    )


DEFAULT_PRIOR = default_prior()
