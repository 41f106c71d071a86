"""Baseline predictors: the last sample, and a logarithm of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.arrays import FloatArray
from palpate.measurement import Status
from palpate.settling.result import SettledEstimate, make_estimate
from palpate.signal.transient import WAIT_S, find_hold_window

#: Two samples for the line and one for its error.
_MIN_SAMPLES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """The last sample, unchanged (paper, Table 1: "recorded resistance").

    There is no interval, because one sample contains no information about the later change.

    Examples
    --------
    >>> hold = Recorded().predict(
    ...     np.array([0.0, 1.0]), np.array([[5.0, 3.0]]), horizon_s=20.0, level=0.9
    ... )
    >>> float(hold.value[0]), hold.status[0].value
    (3.0, 'ok')
    """

    name: ClassVar[str] = "recorded"

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Return the last sample of each hold; see `SettlingMethod.predict`."""
        last, status = values[:, -1].copy(), np.array([Status.OK] * len(values), dtype=object)
        return make_estimate(
            last, status, np.zeros(last.size), horizon_s=horizon_s, level=level, name=self.name
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LogLaw:
    """Least squares of a + b ln(t - t_p + t_0), evaluated at the horizon.

    Attributes
    ----------
    name : str
        Name on the command line and in results.
    wait_s : float
        Time after the peak from which samples are used.
    from_s : float
        t_0, which keeps the logarithm finite at the peak. The default of 0.2 s is about the
        duration of the contact transient.

    Examples
    --------
    >>> time_s = np.arange(0.0, 2.5, 0.1)
    >>> creep = 8.0 - 0.5 * np.log(time_s + 0.2)[None]
    >>> hold = LogLaw().predict(time_s, creep, horizon_s=19.8, level=0.9)
    >>> bool(np.isclose(hold.value[0], 8.0 - 0.5 * np.log(20.0)))
    True
    """

    name: str = "log_law"
    wait_s: float = WAIT_S
    from_s: float = 0.2

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Return the line's value at the horizon; see `SettlingMethod.predict`."""
        window = find_hold_window(time_s, values, wait_s=self.wait_s)
        settled = values[:, -1].copy()
        window_s = np.zeros(len(values))
        status = np.array([Status.TOO_SHORT] * len(values), dtype=object)
        for peak in np.unique(window.peak):
            rows = np.flatnonzero(window.peak == peak)
            first = window.first[rows[0]]
            if time_s.size - first < _MIN_SAMPLES:
                continue
            weights = log_law_weights(
                time_s[first:] - time_s[peak],
                after_s=horizon_s - time_s[peak],
                from_s=self.from_s,
            )
            last = values[rows, -1]
            settled[rows] = last + (values[rows, first:] - last[:, None]) @ weights
            window_s[rows] = time_s[-1] - time_s[first]
            status[rows] = Status.OK
        return make_estimate(
            settled, status, window_s, horizon_s=horizon_s, level=level, name=self.name
        )


def log_law_weights(since_s: FloatArray, *, after_s: float, from_s: float) -> FloatArray:
    """Return the weights of samples in the least-squares line over ln(time + t_0).

    `since_s`, shape (n_times,): times of the samples after the peak, seconds.
    `after_s`: time after the peak at which the line is evaluated.
    `from_s`: t_0.
    """
    log_time = np.log(since_s + from_s)
    middle = np.add.reduce(log_time) / log_time.size
    centred = log_time - middle
    distance = np.log(after_s + from_s) - middle
    return np.asarray(1 / centred.size + centred * (distance / centred.dot(centred)))
