"""The paper's accelerated estimation (equations 2 and 3), done exactly.

Least squares of A exp(-lambda (t - t_p)) + C over the samples from t_p + t_a to t_c; the prediction
is C, the paper's value "after an infinite amount of time", whatever the horizon. Variable
projection needs no starting value and can't fail to converge. What can fail is the question: a
window too short for the rate leaves C undetermined. `docs/paper-notes.md` explains how this reads
equation 3, and why a fit whose C runs away is not taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.settling.result import SettledEstimate, Status
from palpate.settling.varpro import fit_rate
from palpate.signal.transient import WAIT_S, hold_window

#: Three parameters need a fourth sample to be a fit at all.
MIN_SAMPLES = 4
#: A curvature ten times its standard error (F = 100) gives the change still to come to about 10 %.
_CLEAR_CURVATURE = 100.0
#: Range of the rate: from a hundredth of a decay within the window to ten decays per sample.
_SLOWEST_DECAYS = 0.01
_FASTEST_DECAYS_PER_SAMPLE = 10.0
#: Step of the grid in ln(rate), and the steps beyond each end that interpolation asks for.
_GRID_STEP = 0.22
_PADDING = 3
#: From peak to window. At the fastest rates A would overflow; there the fit doesn't stand anyway.
_MOST_DECAYS = 600.0

_STATUS_IF_STANDS = np.array([Status.NOT_SETTLING, Status.OK], dtype=object)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentialFit:
    """Parameters of equation 3, each an array of shape (n_holds,)."""

    #: C where the fit is accepted, the recorded value where it isn't (see `status`).
    settled: FloatArray
    #: A, at the peak; NaN without a fit.
    amplitude: FloatArray
    #: lambda; NaN without a fit.
    rate_per_s: FloatArray
    #: Length of the fitted stretch; 0 where the recorded value is used instead.
    window_s: FloatArray
    #: `ok`; `too_short` with fewer than four samples; `not_settling` where the rate is at an end of
    #: its range (as in a constant window, which has none), or C runs away: it lies further from the
    #: last sample than the signal has come since its peak, and the curvature that puts it there
    #: does not stand clear of the residuals.
    status: NDArray[np.object_]


def fit_exponential(
    time_s: FloatArray, values: FloatArray, *, wait_s: float = WAIT_S
) -> ExponentialFit:
    """Fit equation 3 to holds on shared sampling times.

    `time_s`, shape (n_times,): strictly increasing, up to the cut-off t_c, seconds.
    `values`, shape (n_holds, n_times): finite samples in any unit; equivariant to scale, sign and
    shift.
    `wait_s`: t_a, counted from the peak.

    Source: Paper, equations 2 and 3.

    >>> time_s = np.arange(0.0, 2.5, 1 / 15)
    >>> fit = fit_exponential(time_s, 40 * np.exp(-1.2 * time_s)[None] - 60)
    >>> [round(float(x[0]), 6) for x in (fit.amplitude, fit.rate_per_s, fit.settled)]
    [40.0, 1.2, -60.0]
    """
    window = hold_window(time_s, values, wait_s=wait_s)
    last, n_holds = values[:, -1], len(values)
    settled, window_s = last.copy(), np.zeros(n_holds)
    amplitude, rate_per_s = np.full((2, n_holds), np.nan)
    status = np.array([Status.TOO_SHORT] * n_holds, dtype=object)
    come = np.abs(values[np.arange(n_holds), window.peak] - last)
    for first, rows in window.grids():
        if window.stop - first < MIN_SAMPLES:
            continue
        since_first = time_s[first:] - time_s[first]
        ordinates = values[rows, first:] - last[rows, None]
        length_s = float(since_first[-1])
        fit = fit_rate(since_first, ordinates, rates=_rates(length_s, since_first.size))
        # An offset counts from the last sample.
        near = abs(fit.offset) <= come[rows]
        clear = fit.gained * (since_first.size - MIN_SAMPLES + 1) >= (
            _CLEAR_CURVATURE * fit.unexplained
        )
        stands = (near | clear) & ~fit.at_end
        settled[rows] += np.where(stands, fit.offset, 0.0)
        rate_per_s[rows] = fit.rate
        decays = np.minimum(fit.rate * (time_s[first] - window.peak_s[rows]), _MOST_DECAYS)
        amplitude[rows] = fit.amplitude * np.exp(decays)
        window_s[rows] = stands * length_s
        status[rows] = _STATUS_IF_STANDS[stands.astype(np.intp)]
    return ExponentialFit(
        settled=settled,
        amplitude=amplitude,
        rate_per_s=rate_per_s,
        window_s=window_s,
        status=status,
    )


@lru_cache(maxsize=64)
def _rates(length_s: float, samples: int) -> FloatArray:
    """Return the grid of rates for a window, its padding included."""
    slowest = _SLOWEST_DECAYS / length_s
    fastest = _FASTEST_DECAYS_PER_SAMPLE * (samples - 1) / length_s
    steps = int(np.ceil(np.log(fastest / slowest) / _GRID_STEP))
    rates: FloatArray = slowest * np.exp(_GRID_STEP * np.arange(-_PADDING, steps + _PADDING + 1))
    rates.setflags(write=False)
    return rates


@dataclass(frozen=True, slots=True, kw_only=True)
class Exponential:
    """Equations 2-3 as a predictor of the settled value.

    Attributes
    ----------
    wait_s : float
        t_a, counted from the peak.
    """

    name: ClassVar[str] = "exponential"
    wait_s: float = WAIT_S

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Return C of each hold, or its recorded value; see `SettlingMethod.predict`."""
        fit = fit_exponential(time_s, values, wait_s=self.wait_s)
        return SettledEstimate.without_interval(
            fit.settled,
            horizon_s=horizon_s,
            level=level,
            method=self.name,
            window_s=fit.window_s,
            status=fit.status,
        )
