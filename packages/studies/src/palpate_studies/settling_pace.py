"""Pace of settling: whether a reading comes to rest, or goes on as before in log time."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate_studies.rows import median

#: End of the first interval, s; it begins an e-fold of time before.
CUTOFF_S = 2.5
#: Samples within this fraction of a time are averaged, and the mean of the last 0.5 s.
_AROUND, _END_S = 0.15, 0.5


def measure_pace(time_s: FloatArray, values: FloatArray, *, horizon_s: float) -> float:
    """Return the rate per e-fold of time from 2.5 s to the horizon, relative to that before.

    It is 1 for creep with the logarithm of time, and nearly 0 for a reading at rest. Positive
    values are compared by their logarithm. The result is NaN without samples around these times.

    >>> time_s = np.arange(0.0, 20.0, 0.01)
    >>> round(measure_pace(time_s, (time_s + 0.01) ** -0.05, horizon_s=20.0), 1)
    1.0
    """
    parts = [
        np.abs(time_s - middle_s) <= _AROUND * middle_s for middle_s in (CUTOFF_S / np.e, CUTOFF_S)
    ]
    parts.append((time_s > horizon_s - _END_S) & (time_s <= horizon_s))
    if not all(part.any() for part in parts):
        return float("nan")
    log_time, height = (
        np.array([np.log(series[part]).mean() for part in parts]) for series in (time_s, values)
    )
    before, after = np.diff(height) / np.diff(log_time)
    return float(after / before) if before else float("nan")


def describe_pace(paces: FloatArray) -> dict[str, Any]:
    """Return the 10, 50 and 90 % quantiles of paces, without NaN."""
    quantiles = {"low": 0.1, "median": 0.5, "high": 0.9}
    found = {name: median(paces, quantile) for name, quantile in quantiles.items()}
    return {"holds": int(np.isfinite(paces).sum()), **found}
