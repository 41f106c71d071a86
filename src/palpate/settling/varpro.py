"""Least squares with one nonlinear rate, by variable projection: exact, batched, no starting value.

For a given rate the amplitude and offset of ``amplitude * basis(x, rate) + offset`` are linear and
have a closed form, so the fit is a search over the rate alone (Golub & Pereyra 1973). On an
abscissa that all the fits share, a grid over the rate is one matrix product; interpolation between
its nodes starts Newton's method so near that one step is mostly enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]

#: (x of shape (n_points,), rate of shape (n, 1)) -> array of shape (3, n, n_points): the basis and
#: its first two derivatives with respect to the rate.
Basis: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]

#: Grid nodes to either side of the best that interpolation uses.
_REACH = 3
#: Points between two grid nodes that are compared after interpolation.
_ZOOM = 32
#: A Newton step d in ln(rate) leaves an error of about 1.5 d^2 (measured): at most 1.5e-8.
_LAST_STEP = 1e-4


def decay(x: FloatArray, rate: FloatArray) -> FloatArray:
    """Return exp(-rate x) and its derivatives with respect to the rate."""
    parts = np.empty((3, len(rate), len(x)))
    np.multiply(rate, -x, out=parts[0])
    np.exp(parts[0], out=parts[0])
    np.multiply(parts[0], -x, out=parts[1])
    np.multiply(parts[1], -x, out=parts[2])
    return parts


def saturation(x: FloatArray, rate: FloatArray) -> FloatArray:
    """Return 1 - exp(-rate x) and its derivatives with respect to the rate."""
    parts = -decay(x, rate)
    parts[0] = -np.expm1(-rate * x)
    return parts


@dataclass(frozen=True, slots=True, kw_only=True)
class RateFit:
    """Least-squares parameters of a batch of fits, each of shape (n,).

    Attributes
    ----------
    rate, amplitude, offset : ndarray
        Parameters of ``amplitude * basis(x, rate) + offset``; offset 0 where none was fitted.
    unexplained : ndarray
        Sum of squared residuals.
    gained : ndarray
        How much larger that sum is at the slowest rate of the grid, where a decay is a straight
        line: what the data say about the rate at all.
    at_end : ndarray of bool
        The sum of squares is smallest at an end of the grid: the data don't determine the rate.
    """

    rate: FloatArray
    amplitude: FloatArray
    offset: FloatArray
    unexplained: FloatArray
    gained: FloatArray
    at_end: NDArray[np.bool_]


def fit_rate(
    x: FloatArray, y: FloatArray, *, rates: FloatArray, basis: Basis = decay, offset: bool = True
) -> RateFit:
    """Fit ``amplitude * basis(x, rate) + offset`` to each row of `y`.

    Parameters
    ----------
    x : ndarray, shape (n_points,)
        Abscissa that all the fits share.
    y : ndarray, shape (n, n_points)
        Ordinates.
    rates : ndarray, shape (n_rates,)
        Geometric grid of positive rates, wider than the range of the answer by three steps at each
        end. A basis of exponential type needs steps of at most a factor 1.35.
    basis : callable
        See `Basis`; `decay` or `saturation`, or one of your own.
    offset : bool
        Whether an offset is fitted too.

    Returns
    -------
    RateFit

    References
    ----------
    Golub & Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems
    whose variables separate", SIAM J. Numer. Anal. 10 (1973).

    Examples
    --------
    >>> x = np.linspace(0.0, 2.0, 9)
    >>> fit = fit_rate(x, 3.0 * np.exp(-1.7 * x)[None] - 5.0, rates=np.geomspace(0.01, 100, 40))
    >>> [round(float(part[0]), 8) for part in (fit.rate, fit.amplitude, fit.offset)]
    [1.7, 3.0, -5.0]
    """
    weight = np.full(len(x), 1 / len(x) if offset else 0.0)
    mean = y @ weight
    centred = y - mean[:, None]
    log_rate, at_end, at_slowest = _nearest(x, centred, weight, basis=basis, rates=rates)
    amplitude, shape_mean, explained = np.empty((3, len(y)))
    limit, free = np.log(rates[1] / rates[0]), ~at_end
    active: slice | NDArray[np.intp] = slice(None)
    for _ in range(50):
        rate = np.exp(log_rate[active])
        moments = _Moments(x, centred[active], weight, rate, basis=basis)
        step = moments.newton(limit=limit) * free[active]
        log_rate[active] += step
        change = rate * np.expm1(step)
        amplitude[active], shape_mean[active], explained[active] = moments.linear(change)
        moving = np.abs(step) > _LAST_STEP
        if not moving.any():
            break
        active = np.arange(len(y))[active][moving]
    return RateFit(
        rate=np.exp(log_rate),
        amplitude=amplitude,
        offset=mean - amplitude * shape_mean,
        unexplained=np.maximum(np.einsum("nm,nm->n", centred, centred) - explained, 0.0),
        gained=explained - at_slowest,
        at_end=at_end,
    )


def _zoom_matrix() -> FloatArray:
    """Return what takes values at -3..3 to Lagrange interpolants at -1, -1 + 1/32, ..., 1."""
    nodes = np.arange(-_REACH, _REACH + 1.0)
    fine = np.linspace(-1, 1, 2 * _ZOOM + 1)
    return np.vander(fine, len(nodes)) @ np.linalg.inv(np.vander(nodes))


_INTERPOLATE = _zoom_matrix().T
_NEIGHBOURS = np.arange(-_REACH, _REACH + 1)
_THREE = np.array([[-1], [0], [1]])


def _nearest(
    x: FloatArray, y: FloatArray, weight: FloatArray, *, basis: Basis, rates: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Return ln(rate) near each optimum, where that is an end, and what the slowest explains."""
    table = basis(x, rates[:, None])[0]
    table -= (table @ weight)[:, None]
    table /= np.sqrt(np.einsum("ij,ij->i", table, table))[:, None]
    projection = y @ table.T
    best = np.abs(projection).argmax(axis=1)
    at_end = (best < _REACH) | (best >= len(rates) - _REACH)
    centre = np.minimum(np.maximum(best, _REACH), len(rates) - 1 - _REACH)
    rows = np.arange(len(y))
    fine = np.square(projection[rows[:, None], centre[:, None] + _NEIGHBOURS] @ _INTERPOLATE)
    at = np.minimum(np.maximum(fine.argmax(axis=1), 1), 2 * _ZOOM - 1)
    before, here, after = fine[rows, at + _THREE]
    bend = before - 2 * here + after
    # A parabola through three points; a row without curvature stays where it is.
    shift = 0.5 * (before - after) * (bend < 0) / (bend - (bend == 0))
    position = centre + ~at_end * ((at + np.minimum(np.maximum(shift, -1), 1)) / _ZOOM - 1)
    log_rate = np.log(rates[0]) + position * np.log(rates[1] / rates[0])
    return log_rate, at_end, np.square(projection[:, 0])


class _Moments:
    """Inner products at a given rate, up to second order: p = basis . y, q = basis . basis."""

    def __init__(
        self, x: FloatArray, y: FloatArray, weight: FloatArray, rate: FloatArray, *, basis: Basis
    ) -> None:
        parts = basis(x, rate[:, None])
        self.rate = rate
        self.mean = parts @ weight
        parts -= self.mean[:, :, None]
        self.p = np.einsum("inm,nm->in", parts, y)
        self.q, half_q1, half_q2 = np.einsum("inm,nm->in", parts, parts[0])
        self.q1 = 2 * half_q1
        self.q2 = 2 * (half_q2 + np.einsum("nm,nm->n", parts[1], parts[1]))

    def newton(self, *, limit: float) -> FloatArray:
        """Return the step in ln(rate) towards the largest explained sum of squares, p^2 / q."""
        p, p1, p2 = self.p
        # A row of zeros has nothing to explain at any rate: any denominator will do.
        inverse = 1 / (p + (p == 0))
        by_p, by_q = p1 * inverse, 0.5 * self.q1 / self.q
        # Where the slope is zero the two are equal; taken as equal here, Newton stays quadratic.
        bend = self.rate * (p2 * inverse - 0.5 * self.q2 / self.q + by_p * by_q)
        step = (by_q - by_p) / np.minimum(bend, -1e-12 * self.rate)
        clipped: FloatArray = np.minimum(np.maximum(step, -limit), limit)
        return clipped

    def linear(self, change: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return amplitude, mean of the basis and explained sum after a small change of rate."""
        half = 0.5 * change * change
        p = self.p[0] + self.p[1] * change + self.p[2] * half
        q = self.q + self.q1 * change + self.q2 * half
        return p / q, self.mean[0] + self.mean[1] * change + self.mean[2] * half, p * p / q
