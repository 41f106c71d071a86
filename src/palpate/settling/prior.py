"""What is known of a hold before its first sample, as a mixture of Gaussian priors on its shape.

A hold is a sum of decays whose time constants are spread over log time, a slow random walk in log
time and noise. All amplitudes are relative to one scale, the hold's own, and the offset is left
free: nothing here knows the unit of the values or where their zero is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
        Amplitudes of the decays that make up the component's typical curve.
    weight_variance : ndarray, shape (n_components, n_time_constants)
        Variance of each amplitude about the typical curve.
    walk : ndarray, shape (n_components,)
        Standard deviation that the random walk gains per e-fold of time.
    noise : ndarray, shape (n_components,)
        Standard deviation of one sample.
    contact : ndarray, shape (n_components,)
        Standard deviation of the change that making contact brings, before anything relaxes.
    log_weight : ndarray, shape (n_components,)
        Logarithm of the prior probability, up to a constant.
    """

    mean_weights: FloatArray
    weight_variance: FloatArray
    walk: FloatArray
    noise: FloatArray
    contact: FloatArray
    log_weight: FloatArray


def mixture(priors: Sequence[Prior]) -> Prior:
    """Return one prior of all the components of several."""
    return Prior(
        mean_weights=np.concatenate([p.mean_weights for p in priors]),
        weight_variance=np.concatenate([p.weight_variance for p in priors]),
        walk=np.concatenate([p.walk for p in priors]),
        noise=np.concatenate([p.noise for p in priors]),
        contact=np.concatenate([p.contact for p in priors]),
        log_weight=np.concatenate([p.log_weight for p in priors]),
    )
