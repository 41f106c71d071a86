"""Rupture force of an object, from its stiffness at half of that force.

The model is a line in logarithms, ln(rupture force) = a + b ln(stiffness), with scatter. On
recorded fruit, neither further features of the curve (initial stiffness, bend, closure) nor a
separate line for each force improve the prediction, because they add variance. The stiffness is
that of the upper half of the force so far, so a curve that flattens lowers the prediction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr

from palpate.arrays import FloatArray
from palpate.measurement import Measurement

#: Grid of the stiffness of objects, in its standard deviations.
_GRID = np.linspace(-5.0, 5.0, 401)
#: Fewest objects for a fit.
FEWEST_CLOSINGS = 6
#: Ridge penalty per object: with little spread in stiffness the slope tends to 0.
RIDGE = 1e-3
#: Smallest scatter, ln; a few objects may be on a line by chance.
LEAST_LOG_SD = 0.05

#: Spacing of force levels in ln(force): about 5 %.
LEVEL_STEP = 0.05
#: Force, N, below which sensor and contact geometry affect the curve more than the object does.
LOWEST_N = 0.5
#: Rise of force, as a factor, after which a curve that begins under load has its first state.
GROWTH = 1.15
#: Smallest ratio of forces for a slope, to exceed noise.
SHORTEST_SPAN = 1.03
#: Smallest closure for a slope, mm: the resolution of finger encoders.
SHORTEST_MM = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Strength:
    """Log-normal distribution of the rupture force, given the stiffness."""

    #: Mean and scatter of ln(stiffness) in the training set.
    log_stiffness: float
    stiffness_log_sd: float
    #: ln(rupture force, N) at the mean, and its slope over ln(stiffness).
    log_force: float
    slope: float
    #: Scatter about the line.
    log_sd: float
    #: Size of the training set.
    objects: int

    def median_n(self, state: ClosingState) -> float:
        """Return the force that half of such objects withstand, N."""
        away = state.log_stiffness - self.log_stiffness
        return float(np.exp(self.log_force + self.slope * away))

    def predict_n(self, state: ClosingState) -> float:
        """Return the rupture force, N, that minimises the expected relative error.

        For a log-normal distribution it is one variance (ln) below the median: the error is
        relative to the true value, so overestimates cost more than underestimates.
        """
        # The object has already withstood the present force.
        likely_n = self.median_n(state) * float(np.exp(-(self.log_sd**2)))
        return max(likely_n, state.force_n)

    def rupture_probability(self, force_n: float, log_stiffness: FloatArray) -> FloatArray:
        """Return the probability of rupture below a force, for each stiffness.

        Student's t distribution includes the uncertainty of the line and its scatter.
        """
        log_median = self.log_force + self.slope * (log_stiffness - self.log_stiffness)
        spread = self.log_sd * np.sqrt(1.0 + 1.0 / self.objects)
        return np.asarray(stdtr(self.objects - 2, (np.log(force_n) - log_median) / spread))

    def stiffness_distribution(self, measured: Measurement) -> tuple[FloatArray, FloatArray]:
        """Return values of ln(stiffness) and their probabilities, given a measurement.

        The prior is the training set. The likelihood is normal in compliance on each side of the
        measured value, with the width of its interval.
        """
        log_stiffness = self.log_stiffness + self.stiffness_log_sd * _GRID
        own = measured.mapped(lambda stiffness: 1.0 / stiffness, unit="mm_per_n")
        compliance, middle = np.exp(-log_stiffness), 1.0 / measured.middle
        stiffer, softer = own.side_sds
        spread = np.maximum(np.where(compliance > middle, softer, stiffer), 1e-3 * middle)
        log_weight = -0.5 * (((compliance - middle) / spread) ** 2 + _GRID**2)
        weight = np.exp(log_weight - log_weight.max())
        return log_stiffness, weight / weight.sum()


def fit_strength(
    paths: Sequence[Sequence[ClosingState]], *, rupture_force_n: Sequence[float]
) -> Strength:
    """Fit the line to closings that ended in rupture.

    `paths`: states of each closing; a closing without states above half of its rupture force is
        skipped.
    `rupture_force_n`: rupture force of each object.
    Raises `ValueError` if fewer than `FEWEST_CLOSINGS` objects remain.
    """
    rows = [
        (half.log_stiffness, np.log(limit_n))
        for path, limit_n in zip(paths, rupture_force_n, strict=True)
        if (half := _find_half_load_state(path, limit_n)) is not None
    ]
    if len(rows) < FEWEST_CLOSINGS:
        raise ValueError(
            f"{len(rows)} closings for training; at least {FEWEST_CLOSINGS} are needed"
        )
    stiffness, target = np.array(rows).T
    x, y = stiffness - stiffness.mean(), target - target.mean()
    slope = (x @ y) / (x @ x + RIDGE * len(rows))
    log_sd = np.sqrt(np.sum((y - slope * x) ** 2) / (len(rows) - 2))
    return Strength(
        log_stiffness=float(stiffness.mean()),
        stiffness_log_sd=max(float(stiffness.std(ddof=1)), LEAST_LOG_SD),
        log_force=float(target.mean()),
        slope=float(slope),
        log_sd=max(float(log_sd), LEAST_LOG_SD),
        objects=len(rows),
    )


def _find_half_load_state(path: Sequence[ClosingState], limit_n: float) -> ClosingState | None:
    return next((state for state in path if limit_n / 2 <= state.force_n < limit_n), None)


class ClosingState(NamedTuple):
    """State of a closing curve at one force level."""

    #: The force level just passed.
    force_n: float
    #: ln of the secant stiffness (N/mm) over the upper half of the force.
    log_stiffness: float


class ClosingCurve:
    """Closure at the first crossing of each force level, updated sample by sample.

    First crossings make the curve independent of unloading loops and of the sampling rate.

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
        """Process one sample; return a state for each force level passed, lowest first.

        `closure_mm`: closure of the fingers, from any origin.
        `force_n`: force at that closure, from any source.
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
        for index in range(math.floor(before / LEVEL_STEP) + 1, _count_passed_levels(log_force)):
            log_level = index * LEVEL_STEP
            fraction = (math.exp(log_level) - math.exp(before)) / (force_n - math.exp(before))
            self._log_levels.append(log_level)
            self._closures_mm.append(
                closure_before_mm + fraction * (closure_mm - closure_before_mm)
            )
            if math.exp(log_level) >= self._lowest_n:
                states.append(self._state(math.exp(log_level)))
        self._highest = (log_force, closure_mm)
        return states

    def _state(self, force_n: float) -> ClosingState:
        upper = self._log_slope(force_n / 2, force_n)
        if math.isnan(upper):
            # The rise of force since the start is too small: use all of it.
            upper = self._log_slope(0.0, force_n)
        return ClosingState(force_n=force_n, log_stiffness=upper)

    def _log_slope(self, low_n: float, high_n: float) -> float:
        """Return ln of the slope between two forces; NaN outside the curve."""
        low_n = max(low_n, math.exp(self._log_levels[0]))
        if high_n < SHORTEST_SPAN * low_n:
            return math.nan
        ends_mm = np.interp(np.log([low_n, high_n]), self._log_levels, self._closures_mm)
        return math.log((high_n - low_n) / max(float(ends_mm[1] - ends_mm[0]), SHORTEST_MM))


def _count_passed_levels(log_force: float) -> int:
    return math.floor(log_force / LEVEL_STEP) + 1
