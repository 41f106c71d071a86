"""The paper's accelerated estimation (equations 2 and 3), done exactly.

Least squares of A exp(-lambda (t - t_p)) + C over the samples from t_p + t_a to t_c; the prediction
is C, the paper's value "after an infinite amount of time", whatever the horizon. Variable
projection needs no starting value and can't fail to converge. What can fail is the question: a
window too short for the rate leaves C undetermined. `docs/paper-notes.md` says how this reads
equation 3, and why the rule below replaces the paper's range of -100 to 0 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from palpate.settling.result import FloatArray, SettledEstimate, Status
from palpate.settling.varpro import RateFit, fit_rate
from palpate.signal.transient import WAIT_S, hold_window

#: Three parameters need a fourth sample to be a fit at all.
MIN_SAMPLES = 4
#: Holds fitted at a time: enough to share the cost of a call, few enough to stay in the cache.
_BLOCK = 4096
#: A curvature ten times its standard error (F = 100) gives the change still to come to about 10 %.
_CLEAR_CURVATURE = 100.0
#: Range of the rate: from a hundredth of a decay within the window to ten decays per sample.
_SLOWEST_DECAYS = 0.01
_FASTEST_DECAYS_PER_SAMPLE = 10.0
#: Step of the grid in ln(rate), and the steps beyond each end that interpolation asks for.
_GRID_STEP = 0.22
_PADDING = 3

_STATUS_IF_STANDS = np.array([Status.NOT_SETTLING, Status.OK], dtype=object)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentialFit:
    """Parameters of equation 3, each an array of shape (n_holds,).

    Attributes
    ----------
    settled : ndarray
        C where the fit stands, the recorded value where it doesn't (see `status`).
    amplitude : ndarray
        A, at the peak; NaN without a fit.
    rate_per_s : ndarray
        lambda; NaN without a fit.
    window_s : ndarray
        Length of the fitted stretch; 0 where the recorded value stands in.
    status : ndarray of Status
        `ok`; `too_short` with fewer than four samples; `not_settling` where the rate is at an end
        of its range (as in a constant window, which has none), or C runs away: it lies further from
        the last sample than the signal has come since its peak, and the curvature that puts it
        there does not stand clear of the residuals.
    """

    settled: FloatArray
    amplitude: FloatArray
    rate_per_s: FloatArray
    window_s: FloatArray
    status: NDArray[np.object_]


def fit_exponential(
    time_s: FloatArray, values: FloatArray, *, wait_s: float = WAIT_S
) -> ExponentialFit:
    """Fit equation 3 to holds on shared sampling times.

    Parameters
    ----------
    time_s : ndarray, shape (n_times,)
        Strictly increasing, up to the cut-off t_c, seconds.
    values : ndarray, shape (n_holds, n_times)
        Finite samples in any unit; equivariant to scale, sign and shift.
    wait_s : float
        t_a, counted from the peak.

    Returns
    -------
    ExponentialFit

    References
    ----------
    Paper, equations 2 and 3.

    Examples
    --------
    >>> time_s = np.arange(0.0, 2.5, 1 / 15)
    >>> fit = fit_exponential(time_s, 40 * np.exp(-1.2 * time_s)[None] - 60)
    >>> [round(float(x[0]), 6) for x in (fit.amplitude, fit.rate_per_s, fit.settled)]
    [40.0, 1.2, -60.0]
    """
    n_holds = len(values)
    fit = ExponentialFit(
        settled=values[:, -1].copy(),
        amplitude=np.full(n_holds, np.nan),
        rate_per_s=np.full(n_holds, np.nan),
        window_s=np.zeros(n_holds),
        status=np.array([Status.TOO_SHORT] * n_holds, dtype=object),
    )
    for start in range(0, n_holds, _BLOCK):
        block = slice(start, start + _BLOCK)
        _fit_block(time_s, values[block], wait_s=wait_s, into=fit, offset=start)
    return fit


def _fit_block(
    time_s: FloatArray, values: FloatArray, *, wait_s: float, into: ExponentialFit, offset: int
) -> None:
    """Fit the holds that share a window together, and write them at their place."""
    window = hold_window(time_s, values, wait_s=wait_s)
    for first, rows in window.grids():
        if window.stop - first < MIN_SAMPLES:
            continue
        since_first = time_s[first:] - time_s[first]
        block = values[rows]
        last = block[:, -1]
        fit = fit_rate(since_first, block[:, first:] - last[:, None], rates=_rates(since_first))
        peak = window.peak[rows]
        come = np.abs(block[np.arange(len(rows)), peak] - last)
        stands = _stands(fit, come=come, samples=len(since_first))
        at = rows + offset
        into.settled[at] = last + np.where(stands, fit.offset, 0.0)
        into.rate_per_s[at] = fit.rate
        # At the fastest rates A would overflow; there the fit doesn't stand anyway.
        decays = np.minimum(fit.rate * (time_s[first] - time_s[peak]), 600.0)
        into.amplitude[at] = fit.amplitude * np.exp(decays)
        into.window_s[at] = stands * since_first[-1]
        into.status[at] = _STATUS_IF_STANDS[stands.astype(np.intp)]


def _rates(since_first: FloatArray) -> FloatArray:
    """Return the grid of rates for a window, its padding included."""
    length = since_first[-1]
    slowest = _SLOWEST_DECAYS / length
    fastest = _FASTEST_DECAYS_PER_SAMPLE * (len(since_first) - 1) / length
    steps = int(np.ceil(np.log(fastest / slowest) / _GRID_STEP))
    rates: FloatArray = slowest * np.exp(_GRID_STEP * np.arange(-_PADDING, steps + _PADDING + 1))
    return rates


def _stands(fit: RateFit, *, come: FloatArray, samples: int) -> NDArray[np.bool_]:
    """Return which fits determine their settled value.

    `come` is how far the signal has come since its peak; the offset counts from the last sample.
    """
    near = np.abs(fit.offset) <= come
    clear = fit.gained * (samples - MIN_SAMPLES + 1) >= _CLEAR_CURVATURE * fit.unexplained
    stands: NDArray[np.bool_] = ~fit.at_end & (near | clear)
    return stands


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
        unknown = np.full(len(values), np.nan)
        return SettledEstimate(
            value=fit.settled,
            low=unknown,
            high=unknown.copy(),
            level=level,
            horizon_s=horizon_s,
            window_s=fit.window_s,
            method=self.name,
            status=fit.status,
        )
