"""Holds drawn for timing: they show nothing of accuracy on a sensor."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray

SAMPLES, CUTOFF_S, NOISE_PERCENT = 30, 2.5, 0.03
NOTE = (
    f"Simulated holds: one exponential, {SAMPLES} samples in {CUTOFF_S:g} s on a shared grid, "
    f"noise {NOISE_PERCENT:g} %. Speed only; nothing is shown of accuracy on a sensor."
)


def synthetic_holds(n_holds: int, *, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Return sampling times and single-exponential holds with noise, percent.

    Examples
    --------
    >>> time_s, holds = synthetic_holds(3)
    >>> time_s.shape, holds.shape
    ((30,), (3, 30))
    """
    rng = np.random.default_rng(seed)
    time_s = np.linspace(0.0, CUTOFF_S, SAMPLES)
    rate = np.exp(rng.uniform(np.log(0.4), np.log(4.0), (n_holds, 1)))
    holds = rng.uniform(5.0, 40.0, (n_holds, 1)) * np.exp(-rate * time_s)
    holds += rng.uniform(-72.0, -13.0, (n_holds, 1))
    holds += rng.normal(0.0, NOISE_PERCENT, holds.shape)
    return time_s, holds
