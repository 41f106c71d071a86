"""Least squares with one nonlinear rate, by variable projection: exact, batched, no starting value.

For a given rate the amplitude and offset of ``amplitude * basis(x, rate) + offset`` are linear and
have a closed form, so the fit is a search over the rate alone (Golub & Pereyra 1973). On an
abscissa that all the fits share, a grid over the rate is one matrix product; interpolation between
its nodes starts Newton's method close enough that one step is mostly enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray

#: (x of shape (n_points,), rate of shape (n, 1)) -> array of shape (3, n, n_points): the basis and
#: its first two derivatives with respect to the rate.
Basis: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]

#: Grid nodes to either side of the best that interpolation uses.
_REACH = 3
#: Points between two grid nodes that are compared after interpolation.
_ZOOM = 32
#: A Newton step d in ln(rate) leaves an error of about 1.5 d^2 (measured): at most 1.5e-8.
_LAST_STEP = 1e-4
_MOST_STEPS = 50
#: Points on an abscissa whose table is kept: half a megabyte at most.
_LONGEST_KEPT = 1024


def decay(x: FloatArray, rate: FloatArray) -> FloatArray:
    """Return exp(-rate x) and its derivatives with respect to the rate."""
    parts = np.empty((3, len(rate), len(x)))
    value, slope, bend = parts
    down = -x
    np.multiply(rate, down, out=value)
    np.exp(value, out=value)
    np.multiply(value, down, out=slope)
    np.multiply(slope, down, out=bend)
    return parts


def saturation(x: FloatArray, rate: FloatArray) -> FloatArray:
    """Return 1 - exp(-rate x) and its derivatives with respect to the rate."""
    parts = -decay(x, rate)
    parts[0] = -np.expm1(-rate * x)
    return parts


@dataclass(frozen=True, slots=True, kw_only=True)
class RateFit:
    """Least-squares parameters of a batch of fits, each of shape (n,)."""

    #: Parameters of ``amplitude * basis(x, rate) + offset``; offset 0 where none was fitted.
    rate: FloatArray
    amplitude: FloatArray
    offset: FloatArray
    #: Sum of squared residuals.
    unexplained: FloatArray
    #: How much larger that sum is at the slowest rate of the grid, where a decay is a straight
    #: line: how much information the data carry about the rate.
    gained: FloatArray
    #: The sum of squares is smallest at an end of the grid: the data don't determine the rate.
    at_end: NDArray[np.bool_]


def fit_rate(
    x: FloatArray, y: FloatArray, *, rates: FloatArray, basis: Basis = decay, offset: bool = True
) -> RateFit:
    """Fit ``amplitude * basis(x, rate) + offset`` to each row of `y`.

    `y`, shape (n, n_points): ordinates.
    `rates`, shape (n_rates,): geometric grid of positive rates, wider than the range of the answer
    by three steps at each end. A basis of exponential type needs steps of at most a factor 1.35.

    Source: Golub & Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares
    problems whose variables separate", SIAM J. Numer. Anal. 10 (1973).

    >>> x = np.linspace(0.0, 2.0, 9)
    >>> fit = fit_rate(x, 3.0 * np.exp(-1.7 * x)[None] - 5.0, rates=np.geomspace(0.01, 100, 40))
    >>> [round(float(part[0]), 8) for part in (fit.rate, fit.amplitude, fit.offset)]
    [1.7, 3.0, -5.0]
    """
    table, weight = _grid(x, rates, basis=basis, offset=offset)
    mean = y @ weight
    centred = y - mean[:, None]
    log_rate, at_end, at_slowest = _nearest(centred, table, rates=rates)
    amplitude, shape_mean, explained = np.empty((3, len(y)))
    limit, free = np.log(rates[1] / rates[0]), ~at_end
    active: slice | NDArray[np.intp] = slice(None)
    for _ in range(_MOST_STEPS):
        rate = np.exp(log_rate[active])
        moments = _moments(x, centred[active], weight, rate, basis=basis)
        step = np.clip(moments.newton(), -limit, limit) * free[active]
        log_rate[active] += step
        amplitude[active], shape_mean[active], explained[active] = moments.linear(
            rate * np.expm1(step)
        )
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


def _grid(
    x: FloatArray, rates: FloatArray, *, basis: Basis, offset: bool
) -> tuple[FloatArray, FloatArray]:
    """Work out, or recall, the unit vectors of an abscissa and the weights that average over it."""
    recall = _unit_vectors if len(x) <= _LONGEST_KEPT else _unit_vectors.__wrapped__
    return recall(x.tobytes(), rates.tobytes(), basis, offset)


@lru_cache(maxsize=8)
def _unit_vectors(
    x_bytes: bytes, rates_bytes: bytes, basis: Basis, offset: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the basis at every rate, of length one and centred where offsets are fitted.

    Kept for the last few abscissae: calls one after the other often share theirs.
    """
    x = np.frombuffer(x_bytes)
    weight = np.full(len(x), 1 / len(x) if offset else 0.0)
    table = basis(x, np.frombuffer(rates_bytes)[:, None])[0]
    table -= (table @ weight)[:, None]
    table /= np.sqrt(np.einsum("ij,ij->i", table, table))[:, None]
    table.setflags(write=False)
    weight.setflags(write=False)
    return table, weight


def _nearest(
    y: FloatArray, table: FloatArray, *, rates: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Return ln(rate) near each optimum, where that is an end, and what the slowest explains."""
    projection = y @ table.T
    best = np.abs(projection).argmax(axis=1)
    at_end = (best < _REACH) | (best >= len(rates) - _REACH)
    centre = np.clip(best, _REACH, len(rates) - 1 - _REACH)
    rows = np.arange(len(y))
    fine = np.square(projection[rows[:, None], centre[:, None] + _NEIGHBOURS] @ _INTERPOLATE)
    at = np.clip(fine.argmax(axis=1), 1, 2 * _ZOOM - 1)
    shift = np.clip(_vertex(*fine[rows, at + _THREE]), -1, 1)
    position = centre + ~at_end * ((at + shift) / _ZOOM - 1)
    log_rate = np.log(rates[0]) + position * np.log(rates[1] / rates[0])
    return log_rate, at_end, np.square(projection[:, 0])


def _vertex(before: FloatArray, here: FloatArray, after: FloatArray) -> FloatArray:
    """Return where the parabola through -1, 0, 1 has its top; 0 where it has none."""
    bend = before - 2 * here + after
    return np.asarray(0.5 * (before - after) * (bend < 0) / (bend - (bend == 0)))


@dataclass(frozen=True, slots=True)
class _Moments:
    """Inner products at given rates, of the centred basis with the data (p) and itself (q).

    Each of mean, p and q is followed by its two derivatives with respect to the rate.
    """

    rate: FloatArray
    mean: FloatArray
    p: FloatArray
    q: tuple[FloatArray, FloatArray, FloatArray]

    def newton(self) -> FloatArray:
        """Return the step in ln(rate) towards the largest explained sum of squares, p^2 / q."""
        p, p1, p2 = self.p
        q, q1, q2 = self.q
        # A row of zeros has nothing to explain at any rate: any denominator will do.
        inverse = 1 / (p + (p == 0))
        by_p, by_q = p1 * inverse, 0.5 * q1 / q
        # Where the slope is zero the two are equal; taken as equal here, Newton stays quadratic.
        bend = self.rate * (p2 * inverse - 0.5 * q2 / q + by_p * by_q)
        flattest = -1e-12 * self.rate
        return np.asarray((by_q - by_p) / (bend + (bend > flattest) * (flattest - bend)))

    def linear(self, change: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return amplitude, mean of the basis and explained sum after a small change of rate."""
        half = 0.5 * change * change
        p, q, mean = (m[0] + m[1] * change + m[2] * half for m in (self.p, self.q, self.mean))
        return p / q, mean, p * p / q


def _moments(
    x: FloatArray, y: FloatArray, weight: FloatArray, rate: FloatArray, *, basis: Basis
) -> _Moments:
    parts = basis(x, rate[:, None])
    mean = parts @ weight
    parts -= mean[:, :, None]
    q, half_q1, half_q2 = np.einsum("inm,nm->in", parts, parts[0])
    q2 = 2 * (half_q2 + np.einsum("nm,nm->n", parts[1], parts[1]))
    return _Moments(rate, mean, np.einsum("inm,nm->in", parts, y), (q, 2 * half_q1, q2))
