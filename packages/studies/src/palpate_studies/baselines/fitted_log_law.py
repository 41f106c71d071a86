"""Baseline: a logarithm of time with a fitted time offset."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from palpate.arrays import FloatArray
from palpate.measurement import Status
from palpate.settling.result import SettledEstimate, make_estimate

#: Time offsets that are tried, s. For each one the line is a linear least-squares fit.
_OFFSETS_S = np.geomspace(5e-3, 20.0, 80)
_MIN_SAMPLES = 4


class FittedLogLaw:
    """Least squares of a + b ln(t + c) over all samples, evaluated at the horizon.

    >>> time_s = np.arange(0.0, 2.5, 0.05)
    >>> hold = 8.0 - 0.5 * np.log(time_s + 0.7)[None]
    >>> found = FittedLogLaw().predict(time_s, hold, horizon_s=20.0, level=0.9)
    >>> bool(abs(found.value[0] - (8.0 - 0.5 * np.log(20.7))) < 0.01)
    True
    """

    name: ClassVar[str] = "log_law_fitted"

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Return the law's value at the horizon; see `SettlingMethod.predict`."""
        settled, count = values[:, -1].copy(), len(values)
        status = np.array([Status.TOO_SHORT] * count, dtype=object)
        if time_s.size >= _MIN_SAMPLES:
            log_time = np.log(time_s + _OFFSETS_S[:, None])
            centred = log_time - log_time.mean(axis=1, keepdims=True)
            mean = values.mean(axis=1)
            # Shape (n_offsets, n_holds).
            slope = centred @ (values - mean[:, None]).T
            slope /= np.square(centred).sum(axis=1)[:, None]
            explained = slope**2 * np.square(centred).sum(axis=1)[:, None]
            best = explained.argmax(axis=0)
            ahead = np.log(horizon_s + _OFFSETS_S) - log_time.mean(axis=1)
            settled = mean + slope[best, np.arange(count)] * ahead[best]
            status[:] = Status.OK
        return make_estimate(
            settled, status, np.zeros(count), horizon_s=horizon_s, level=level, name=self.name
        )
