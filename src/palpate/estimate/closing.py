"""The force-closure curve of one closing, reduced as it grows to what tells damage ahead."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

#: Forces are looked at in steps of this size in ln(force): about 5 %.
LEVEL_STEP = 0.05
#: Below this force, N, sensors and contact geometry say more than the object does.
LOWEST_N = 0.5
#: A curve that begins under load says nothing before the force has grown by this factor.
GROWTH = 1.15
#: A slope over a smaller ratio of forces than this would be mostly noise.
SHORTEST_SPAN = 1.03
#: Smallest closure, mm, that a slope is taken over: the resolution of finger encoders.
SHORTEST_MM = 1e-3


class ClosingState(NamedTuple):
    """What the curve up to `force_n` says."""

    #: The force level just passed.
    force_n: float
    #: ln of the secant stiffness (N/mm) over the upper half of the force.
    log_stiffness: float


class ClosingCurve:
    """Closure at the first crossing of each force level, grown sample by sample.

    First crossings make the curve indifferent to unloading loops and to the sampling rate.

    Examples
    --------
    A spring of 2 N/mm:

    >>> curve = ClosingCurve()
    >>> closure_mm = np.linspace(0.1, 4.0, 400)
    >>> states = [s for x in closure_mm for s in curve.push(x, force_n=2 * x)]
    >>> round(math.exp(states[-1].log_stiffness), 3)
    2.0
    """

    def __init__(self) -> None:
        self._log_levels: list[float] = []
        self._closures_mm: list[float] = []
        self._highest: tuple[float, float] | None = None
        self._lowest_n = math.inf

    def push(self, closure_mm: float, *, force_n: float) -> list[ClosingState]:
        """Take one sample; return a state for each force level that it passed, lowest first.

        Parameters
        ----------
        closure_mm : float
            How far the fingers have closed, from any origin.
        force_n : float
            Force at that moment, from any source.
        """
        if force_n <= 0:
            return []
        log_force = math.log(force_n)
        if self._highest is None:
            self._highest = (log_force, closure_mm)
            self._lowest_n = max(LOWEST_N, GROWTH * force_n)
            return []
        before, closure_before_mm = self._highest
        if log_force <= before:
            return []
        states = []
        for index in range(math.floor(before / LEVEL_STEP) + 1, _levels_passed(log_force)):
            log_level = index * LEVEL_STEP
            share = (math.exp(log_level) - math.exp(before)) / (force_n - math.exp(before))
            self._log_levels.append(log_level)
            self._closures_mm.append(closure_before_mm + share * (closure_mm - closure_before_mm))
            if math.exp(log_level) >= self._lowest_n:
                states.append(self._state(math.exp(log_level)))
        self._highest = (log_force, closure_mm)
        return states

    def _state(self, force_n: float) -> ClosingState:
        upper = self._log_slope(force_n / 2, force_n)
        if math.isnan(upper):
            # Too little force since the curve began: all of it is the best there is.
            upper = self._log_slope(0.0, force_n)
        return ClosingState(force_n=force_n, log_stiffness=upper)

    def _log_slope(self, low_n: float, high_n: float) -> float:
        """Return ln of the slope between two forces, NaN where the curve doesn't span them."""
        low_n = max(low_n, math.exp(self._log_levels[0]))
        if high_n < SHORTEST_SPAN * low_n:
            return math.nan
        ends_mm = np.interp(np.log([low_n, high_n]), self._log_levels, self._closures_mm)
        return math.log((high_n - low_n) / max(float(ends_mm[1] - ends_mm[0]), SHORTEST_MM))


def _levels_passed(log_force: float) -> int:
    return math.floor(log_force / LEVEL_STEP) + 1
