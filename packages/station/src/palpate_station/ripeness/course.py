"""Softening curve of one kind of produce, and the position of an item on it.

Firmness (a logarithm, see `palpate_station.ripeness.firmness`) falls along a logistic curve from a
hard level to a soft level. Items differ in the day on which they are halfway, in pace and in
initial firmness. The readings of a day scatter about the curve. No curve is fitted to a single
item. Instead, all possible courses of the item are weighted by their agreement with its grasps so
far (Bayes over a grid). A single day is therefore sufficient for a first estimate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.special import logsumexp, softmax

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate_station.ripeness.firmness import DayFirmness, pool_variance

#: Minimum number of items, and of days per item, for learning a course.
FEWEST_COURSES, FEWEST_DAYS = 4, 3
#: Grid of possible courses, in standard deviations from the mean: halfway day, pace and initial
#: firmness.
_HALFWAY, _PACE, _START = (np.linspace(-r, r, n) for r, n in ((2.6, 53), (2.0, 7), (2.4, 7)))
#: Degrees of freedom of the t distribution of a day's error, which limits the weight of an outlier.
_FREEDOM = 5.0
#: Weight of the prior scatter between grasps, as a number of grasps.
_PRIOR_GRASPS = 6
#: Minimum fall of a course. It applies to a sampled start below the soft level.
_LEAST_FALL = 1e-3
#: Spread of the pace within one kind (log sd); a few items are too few to estimate it.
_PACE_LOG_SD = 0.3
#: Weak priors: pace (time of an e-fold), and scatter as a fraction of the total fall.
_PRIOR_PACE_DAYS, _PRIOR_NOISE_FRACTION = 1.0, 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """Softening of one kind of produce, as measured by one rig."""

    #: Mean firmness before and after softening.
    hard: float
    soft: float
    #: Standard deviation between items of the firmness before softening.
    start_sd: float
    #: Mean and standard deviation of the halfway day, in days from an item's first grasp.
    halfway_day: float
    halfway_sd: float
    #: Median time scale of the logistic curve.
    pace_days: float
    #: Standard deviation of a day's firmness about the item's course, for any number of grasps.
    noise_sd: float
    #: Usual standard deviation between grasps of one day; averaging over grasps reduces it.
    grasp_sd: float

    @classmethod
    def learn(cls, items: Sequence[Sequence[DayFirmness]]) -> Course:
        """Learn the course from items grasped on several days, by maximum marginal likelihood.

        Raises `InputError` if there are too few items, or no item softened.
        """
        # Sorted, so that rounding errors do not depend on the order of the items.
        useful = sorted(
            (item for item in items if len(item) >= FEWEST_DAYS),
            key=lambda item: [(day.day, day.firmness) for day in item],
        )
        if len(useful) < FEWEST_COURSES:
            raise InputError(
                f"{len(useful)} items were grasped on {FEWEST_DAYS} days or more, but a course "
                f"of ripening requires {FEWEST_COURSES}; grasp some items daily until they are soft"
            )
        firmness = np.concatenate([[day.firmness for day in item] for item in useful])
        low, high = (float(level) for level in np.quantile(firmness, [0.05, 0.95]))
        fall = max(high - low, 1e-3)
        last_day = max(1.0, *(day.day for item in useful for day in item))
        grasp_sd = math.sqrt(pool_variance([day for item in useful for day in item]))

        def course_at(offset: FloatArray) -> Course:
            """Return the course at offsets, in standard deviations, from the weak priors."""
            return cls(
                hard=high + 0.25 * fall * float(offset[0]),
                soft=low + 0.25 * fall * float(offset[1]),
                start_sd=0.1 * fall * float(np.exp(0.5 * offset[2])),
                halfway_day=last_day * (0.5 + 0.5 * float(offset[3])),
                halfway_sd=0.4 * last_day * float(np.exp(0.4 * offset[4])),
                pace_days=_PRIOR_PACE_DAYS * float(np.exp(0.5 * offset[5])),
                noise_sd=_PRIOR_NOISE_FRACTION * fall * float(np.exp(0.7 * offset[6])),
                grasp_sd=grasp_sd,
            )

        def loss(offset: FloatArray) -> float:
            course = course_at(offset)
            evidence = sum(course.weigh_courses(item).log_evidence for item in useful)
            return float(0.5 * offset @ offset - evidence)

        best = minimize(loss, np.zeros(7), method="L-BFGS-B", options={"maxiter": 60, "eps": 1e-4})
        found = course_at(best.x)
        if found.hard - found.soft < 2 * found.noise_sd:
            raise InputError(
                "no item softened by more than the scatter of its grasps; "
                "grasp on more days, or more often per day"
            )
        return found

    def weigh_courses(self, days: Sequence[DayFirmness]) -> Courses:
        """Return an item's possible courses, weighted by agreement with its daily measurements."""
        steps = np.meshgrid(_HALFWAY, _PACE, _START, indexing="ij")
        by_halfway, by_pace, by_start = (one.ravel() for one in steps)
        halfway = self.halfway_day + self.halfway_sd * by_halfway
        pace = self.pace_days * np.exp(_PACE_LOG_SD * by_pace)
        hard = np.maximum(self.hard + self.start_sd * by_start, self.soft + _LEAST_FALL)
        log_prior = -0.5 * (by_halfway**2 + by_pace**2 + by_start**2)
        noise_sd = np.hypot(self.noise_sd, [self.mean_sd(day) for day in days])
        remaining = _remaining_fall([day.day for day in days], halfway, pace)
        expected = self.soft + (hard - self.soft)[:, None] * remaining
        squared = ((np.array([day.firmness for day in days]) - expected) / noise_sd) ** 2
        log_like = -0.5 * (_FREEDOM + 1.0) * np.log1p(squared / _FREEDOM).sum(axis=1)
        log_weight = log_prior + log_like - np.log(noise_sd).sum()
        log_evidence = float(logsumexp(log_weight) - logsumexp(log_prior))
        return Courses(
            halfway_day=halfway,
            pace_days=pace,
            hard=hard,
            soft=self.soft,
            weight=softmax(log_weight),
            log_evidence=log_evidence,
        )

    def mean_sd(self, day: DayFirmness) -> float:
        """Return the standard deviation of a day's mean from the scatter of its grasps."""
        freedom = day.grasps - 1
        own = freedom * day.spread**2 if freedom else 0.0
        variance = (_PRIOR_GRASPS * self.grasp_sd**2 + own) / (_PRIOR_GRASPS + freedom)
        return math.sqrt(variance / day.grasps)


@dataclass(frozen=True, slots=True, kw_only=True)
class Courses:
    """Possible courses of one item with their probabilities; arrays of shape (courses,)."""

    halfway_day: FloatArray
    pace_days: FloatArray
    hard: FloatArray
    soft: float
    weight: FloatArray
    log_evidence: float

    def firmness(self, day: ArrayLike) -> FloatArray:
        """Return the firmness of every course on days, shape (courses, days)."""
        remaining = _remaining_fall(np.atleast_1d(day), self.halfway_day, self.pace_days)
        return np.asarray(self.soft + (self.hard[:, None] - self.soft) * remaining)

    def mean_firmness(self, day: float) -> float:
        """Return the expected firmness on a day."""
        return float(self.weight @ self.firmness(day)[:, 0])

    def day_below(self, firmness: float) -> FloatArray:
        """Return the day on which each course falls below a firmness, shape (courses,).

        The day is inf for a course that stays above, and -inf for a course that was always below.
        """
        fraction = (firmness - self.soft) / (self.hard - self.soft)
        with np.errstate(divide="ignore", invalid="ignore"):
            day = self.halfway_day + self.pace_days * np.log(1.0 / fraction - 1.0)
        return np.where(fraction <= 0, np.inf, np.where(fraction >= 1, -np.inf, day))

    def quantile(self, values: FloatArray, q: ArrayLike) -> FloatArray:
        """Return weighted quantiles of one value per course."""
        order = np.argsort(values)
        cumulative = np.cumsum(self.weight[order])
        index = np.searchsorted(cumulative, np.asarray(q) * cumulative[-1])
        return np.asarray(values[order][np.minimum(index, values.size - 1)])


def _remaining_fall(day: ArrayLike, halfway_day: FloatArray, pace_days: FloatArray) -> FloatArray:
    """Return the remaining fraction of each course's fall, shape (courses, days)."""
    since = np.asarray(day, dtype=float) - halfway_day[:, None]
    return np.asarray(0.5 * (1.0 - np.tanh(0.5 * since / pace_days[:, None])))
