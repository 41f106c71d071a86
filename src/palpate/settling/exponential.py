"""The paper's accelerated estimation (equations 2 and 3), with an exact fit.

The fit is least squares of A exp(-lambda (t - t_p)) + C over the samples from t_p + t_a to t_c. The
prediction is C, the paper's value "after an infinite amount of time", at every horizon. For a given
rate, A and C have a closed form. The fit is therefore a search over the rate, without a starting
value (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10, 1973). A window too short for
the rate leaves C undetermined. `docs/paper-notes.md` explains this interpretation of equation 3,
and why a fit with a diverging C is rejected.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.measurement import Status
from palpate.settling.result import SettledEstimate, make_estimate
from palpate.signal.transient import find_hold_window

#: One sample more than the number of parameters.
MIN_SAMPLES = 4
#: A curvature of ten standard errors (F = 100) determines the later change to about 10 %.
_CLEAR_CURVATURE = 100.0
#: Range of the rate: from a hundredth of a decay within the window to ten decays per sample.
_SLOWEST_DECAYS, _FASTEST_DECAYS_PER_SAMPLE = 0.01, 10.0
#: Grid step in ln(rate), small enough for Newton's method to converge from between two nodes.
_GRID_STEP = 0.1
#: The error after a Newton step d in ln(rate) is about 1.5 d^2 (measured): at most 1.5e-8.
_LAST_STEP, _MAX_STEPS = 1e-4, 50
#: Limit of the decays from peak to window, which prevents an overflow of A.
_MAX_DECAYS = 600.0
#: Nodes around the best one, and the weights of their values in the coefficients of the derivative
#: of the polynomial through them.
_MARGIN, _NODES = 2, np.arange(-2, 3)[:, None]
_DERIVATIVE = np.arange(1, 5)[:, None] * np.linalg.inv(np.vander(_NODES[:, 0], increasing=True))[1:]
_TINY = 1e-290
_STATUS_IF_ACCEPTED = np.array([Status.NOT_SETTLING, Status.OK], dtype=object)


class ExponentialFit(NamedTuple):
    """Parameters of equation 3, each an array of shape (n_holds,)."""

    #: C if the fit is accepted, otherwise the recorded value (see `status`).
    settled: FloatArray
    #: A at the peak, and lambda; NaN without a fit.
    amplitude: FloatArray
    rate_per_s: FloatArray
    #: Duration of the fitted samples; 0 if the recorded value is used instead.
    window_s: FloatArray
    #: `ok`; `too_short` with fewer than four samples; `not_settling` if the rate is at an end of
    #: its range (as in a constant window), or if C diverges. C diverges if it is further from the
    #: last sample than the change since the peak, and the curvature does not clearly exceed the
    #: residuals.
    status: NDArray[np.object_]


def fit_exponential(time_s: FloatArray, values: FloatArray) -> ExponentialFit:
    """Fit equation 3 to holds with common sampling times.

    `time_s`, shape (n_times,): strictly increasing, up to the cut-off t_c, seconds.
    `values`, shape (n_holds, n_times): finite samples in any unit. The fit is equivariant to scale,
        sign and offset.

    Source: Paper, equations 2 and 3.

    >>> time_s = np.arange(0.0, 2.5, 1 / 15)
    >>> fit = fit_exponential(time_s, 40 * np.exp(-1.2 * time_s)[None] - 60)
    >>> [round(float(x[0]), 6) for x in (fit.amplitude, fit.rate_per_s, fit.settled)]
    [40.0, 1.2, -60.0]
    """
    window = find_hold_window(time_s, values)
    last, n_holds = values[:, -1], len(values)
    settled, window_s = last.copy(), np.zeros(n_holds)
    amplitude, rate_per_s = np.full((2, n_holds), np.nan)
    status = np.array([Status.TOO_SHORT] * n_holds, dtype=object)
    change = np.abs(values[np.arange(n_holds), window.peak] - last)
    for first, rows in window.group_by_first():
        if time_s.size - first < MIN_SAMPLES:
            continue
        since_first = time_s[first:] - time_s[first]
        ordinates = values[rows, first:] - last[rows, None]
        fit = fit_decay(since_first, ordinates)
        # Offsets are relative to the last sample.
        is_near = abs(fit.offset) <= change[rows]
        is_clear = fit.gained * (since_first.size - MIN_SAMPLES + 1) >= (
            _CLEAR_CURVATURE * fit.unexplained
        )
        accepted = (is_near | is_clear) & ~fit.is_at_end
        settled[rows] += np.where(accepted, fit.offset, 0.0)
        rate_per_s[rows] = fit.rate
        decays = np.minimum(fit.rate * (time_s[first] - window.peak_s[rows]), _MAX_DECAYS)
        amplitude[rows] = fit.amplitude * np.exp(decays)
        window_s[rows] = accepted * since_first[-1]
        status[rows] = _STATUS_IF_ACCEPTED[accepted.astype(np.intp)]
    return ExponentialFit(settled, amplitude, rate_per_s, window_s, status)


class DecayFit(NamedTuple):
    """Least-squares parameters of a batch of decays, each of shape (n,)."""

    rate: FloatArray
    amplitude: FloatArray
    offset: FloatArray
    #: Sum of squared residuals, and its reduction relative to the slowest decay, a straight line.
    unexplained: FloatArray
    gained: FloatArray
    #: Whether the best rate is at an end of the grid, so that the data do not determine the rate.
    is_at_end: NDArray[np.bool_]


def fit_decay(x: FloatArray, y: FloatArray) -> DecayFit:
    """Fit ``amplitude * exp(-rate x) + offset`` to each row of `y`.

    `x`, shape (n_points,), increasing from 0; `y`, shape (n, n_points).

    >>> x = np.linspace(0.0, 2.0, 9)
    >>> fit = fit_decay(x, 3.0 * np.exp(-1.7 * x)[None] - 5.0)
    >>> [round(float(part[0]), 8) for part in (fit.rate, fit.amplitude, fit.offset)]
    [1.7, 3.0, -5.0]
    """
    log_rates, table = _tabulate_decays(x.tobytes())
    mean = np.add.reduce(y, axis=1) / x.size
    centred = y - mean[:, None]
    gains = np.square(centred.dot(table.T))
    best = gains.argmax(axis=1)
    centre = np.minimum(np.maximum(best, _MARGIN), log_rates.size - 1 - _MARGIN)
    is_at_end = best != centre
    rows = np.arange(len(y))
    # Maximum of the polynomial through five nodes, by one Newton step from that of a parabola.
    slope, curvature, third, fourth = _DERIVATIVE.dot(gains[rows, centre + _NODES])
    curvature = np.minimum(curvature, -_TINY)
    shift = -slope / curvature
    bend = np.minimum(curvature + shift * (2 * third + 3 * fourth * shift), -_TINY)
    shift -= shift * shift * (third + fourth * shift) / bend
    shift = np.minimum(np.maximum(shift, -1.0), 1.0) * ~is_at_end
    log_rate = log_rates.take(centre) + _GRID_STEP * shift
    amplitude, shape_mean, explained = linear = np.empty((3, len(y)))
    active: slice | NDArray[np.intp] = slice(None)
    for _ in range(_MAX_STEPS):
        step, linear[:, active] = _newton_step(
            x, centred[active], log_rate[active], free=~is_at_end[active]
        )
        log_rate[active] += step
        is_moving = np.abs(step) > _LAST_STEP
        if not np.count_nonzero(is_moving):
            break
        active = rows[active][is_moving]
    unexplained = np.maximum(np.add.reduce(centred * centred, axis=1) - explained, 0.0)
    gained = explained - gains[:, _MARGIN - 1]
    offset = mean - amplitude * shape_mean
    return DecayFit(np.exp(log_rate), amplitude, offset, unexplained, gained, is_at_end)


@lru_cache(maxsize=8)
def _tabulate_decays(x_bytes: bytes) -> tuple[FloatArray, FloatArray]:
    """Return the grid of ln(rate), and the centred decay of unit norm for each rate."""
    x = np.frombuffer(x_bytes)
    slowest = _SLOWEST_DECAYS / x[-1]
    fastest = _FASTEST_DECAYS_PER_SAMPLE * (x.size - 1) / x[-1]
    steps = int(np.ceil(np.log(fastest / slowest) / _GRID_STEP))
    log_rates = np.log(slowest) + _GRID_STEP * np.arange(-_MARGIN, steps + 1 + _MARGIN)
    table = np.exp(-np.exp(log_rates)[:, None] * x)
    table -= table.mean(axis=1, keepdims=True)
    return log_rates, table / np.sqrt(np.einsum("ij,ij->i", table, table))[:, None]


def _newton_step(
    x: FloatArray, y: FloatArray, log_rate: FloatArray, *, free: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return the step in ln(rate); and the amplitude, the mean decay and the explained sum.

    The explained sum is p^2 / q. Here p is the product of the centred decay with the data, and q
    its product with itself. Both are computed with two derivatives with respect to the rate.
    """
    rate = np.exp(log_rate)
    parts = np.empty((len(rate), 3, x.size))
    np.exp(-rate[:, None] * x, out=parts[:, 0])
    np.multiply(parts[:, 0], -x, out=parts[:, 1])
    np.multiply(parts[:, 1], -x, out=parts[:, 2])
    mean = np.add.reduce(parts, axis=2) / x.size
    parts -= mean[:, :, None]
    p, p1, p2 = (parts @ y[:, :, None])[:, :, 0].T
    products = parts @ parts.transpose(0, 2, 1)
    q, half_q1, half_q2 = products[:, 0].T
    q1, q2 = 2 * half_q1, 2 * (half_q2 + products[:, 1, 1])
    # For a row of zeros p is 0 at any rate, and the denominator is arbitrary.
    inverse = 1 / (p + (p == 0))
    by_p, by_q = p1 * inverse, half_q1 / q
    # by_p equals by_q at the optimum. Using this here preserves quadratic convergence.
    curvature = rate * (p2 * inverse - 0.5 * q2 / q + by_p * by_q)
    step = (by_q - by_p) / np.minimum(curvature, -1e-12 * rate)
    step = np.minimum(np.maximum(step, -_GRID_STEP), _GRID_STEP) * free
    change = rate * np.expm1(step)
    half = 0.5 * change * change
    p_then, q_then, mean_then = (
        m[0] + m[1] * change + m[2] * half for m in ((p, p1, p2), (q, q1, q2), mean.T)
    )
    amplitude = p_then / q_then
    return step, np.array((amplitude, mean_then, p_then * amplitude))


@dataclass(frozen=True, slots=True, kw_only=True)
class Exponential:
    """Equations 2 and 3 of the paper as a predictor of the settled value."""

    name: ClassVar[str] = "exponential"

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Return C of each hold, or its recorded value; see `SettlingMethod.predict`."""
        fit = fit_exponential(time_s, values)
        return make_estimate(
            fit.settled, fit.status, fit.window_s, horizon_s=horizon_s, level=level, name=self.name
        )
