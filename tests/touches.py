"""Recordings as users have them: a sensor at rest, touched a few times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: When the fingers close and open, seconds.
TOUCHES = ((2.0, 25.0), (30.0, 54.0), (60.0, 83.0))
LOADING_S = 0.15


def resistance_ohm(
    time_s: NDArray[np.float64],
    *,
    touches: tuple[tuple[float, float], ...] = TOUCHES,
    rest_ohm: float = 2000.0,
    noise: float = 0.002,
    drift: float = 0.0,
    seed: int = 1,
) -> NDArray[np.float64]:
    """Return a sheet whose resistance falls to a fifth in contact and creeps a tenth."""
    log_ohm = np.full(time_s.size, np.log(rest_ohm)) + drift * time_s / time_s[-1]
    for number, (close_s, open_s) in enumerate(touches):
        held = (time_s >= close_s) & (time_s < open_s)
        since_s = time_s[held] - close_s
        depth = 1.6 + 0.1 * number
        log_ohm[held] -= depth * np.clip(since_s / LOADING_S, 0, 1)
        log_ohm[held] -= 0.03 * np.log1p(since_s / 0.3)
        after = time_s >= open_s
        log_ohm[after] += 0.1 * np.exp(-(time_s[after] - open_s) / 1.5)
    log_ohm += noise * np.random.default_rng(seed).normal(size=time_s.size)
    return np.exp(log_ohm)


def counts(ohm: NDArray[np.float64], *, leg: str, reference_ohm: float, bits: int = 10) -> NDArray:
    """Return what a converter reads of a divider."""
    share = reference_ohm / (reference_ohm + ohm) if leg == "upper" else ohm / (reference_ohm + ohm)
    return np.rint(share * (2**bits - 1)).astype(int)
