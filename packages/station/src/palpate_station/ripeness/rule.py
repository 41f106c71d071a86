"""Ripeness of one item: stage, probabilities and days to ripe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate_station.learning import LabelLearner
from palpate_station.ripeness.course import Course
from palpate_station.ripeness.firmness import DayFirmness
from palpate_station.ripeness.stages import RIPE, STAGES, first_day_probabilities

#: A stage with a lower probability is reported as uncertain.
CONFIDENT_PROBABILITY = 0.9
#: Nominal coverage of the interval of the days to ripe.
LEVEL = 0.9
#: Factor that widens the interval of the weighted courses. It accounts for the uncertainty of the
#: mean course from few labelled items, for courses that are not logistic, and for changes of room
#: temperature. Coverage on 322 fruit days of seven development stations (twelve labelled fruits
#: each): 88 % at 1.0, 90 % at 1.1, 92 % at 1.2. On 200 further fruits 1.1 covered only 83 % with
#: rigid fingers (soft: 91 %). The factor was therefore set to 1.2, which covers 87 and 94 % of
#: these fruits.
_WIDENING = 1.2
#: Gauss-Hermite nodes for the error of a day's firmness, in standard deviations.
_NODES, _NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_NODE_WEIGHTS = _NODE_WEIGHTS / _NODE_WEIGHTS.sum()


@dataclass(frozen=True, slots=True, kw_only=True)
class Days:
    """Days until a stage, with an interval; negative if the stage has passed."""

    #: Median and limits of the interval, days; infinite if the stage may never be reached.
    value: float
    low: float
    high: float

    @property
    def text(self) -> str:
        """The time until ripe, as text."""
        if self.high <= 0:
            return "ripe, or past it"
        value, low, high = map(_end_text, (self.value, self.low, self.high))
        return f"{value} ({low} to {high})"


def _end_text(days: float) -> str:
    if math.isinf(days):
        return "never"
    return f"{days:.1f}" if days >= 0.05 else "now"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ripeness:
    """The ripeness of one item on one day."""

    #: The most probable stage.
    stage: str
    #: Probability of every stage, firmest first.
    probabilities: dict[str, float]
    #: Firmness on that day; with a course, estimated from all grasps up to that day.
    firmness: float
    #: Days until the ripe stage begins; None without a course.
    days_to_ripe: Days | None
    #: Source of the stages: "labels" or "first day".
    basis: str

    @property
    def is_uncertain(self) -> bool:
        """Whether the stage is uncertain, so that another grasp on the same day helps."""
        return max(self.probabilities.values()) < CONFIDENT_PROBABILITY


@dataclass(frozen=True, slots=True, kw_only=True)
class RipenessRule:
    """Rule for one kind on one rig: stages from labels, days from the course.

    The stage depends on the firmness of the day only. On fruit from five generators, no learner
    with all days so far identified more stages (`palpate study ripeness --second`).
    """

    #: Softening of the kind over days.
    course: Course
    #: All stages in order, firmest first.
    stages: tuple[str, ...]
    #: Classifier of the stage from the firmness of a day.
    learner: LabelLearner

    @classmethod
    def learn(
        cls,
        items: Sequence[Sequence[DayFirmness]],
        *,
        labels: Sequence[Sequence[str | None]],
        stages: Sequence[str],
    ) -> RipenessRule:
        """Learn from items grasped over days, some of them labelled.

        `items`: each item's days.
        `labels`: stage of each item on each of its days; None without a person's label.
        `stages`: all stages in order, firmest first.
        Raises `InputError` if there are too few items, a label is not a stage, or a stage has no
        label; `MissingExtraError` if scikit-learn is not installed.
        """
        course = Course.learn(items)
        known = [
            (day.firmness, name, str(number))
            for number, (item, names) in enumerate(zip(items, labels, strict=True))
            for day, name in zip(item, names, strict=True)
            if name is not None
        ]
        return cls(
            course=course,
            stages=tuple(stages),
            learner=learn_stages(
                [firmness for firmness, *_ in known],
                [name for _, name, _ in known],
                items=[item for *_, item in known],
                stages=stages,
            ),
        )

    def probabilities(self, firmness: ArrayLike) -> FloatArray:
        """Return the probability of each stage, firmest first, shape (n, stages)."""
        order = [self.learner.labels.index(stage) for stage in self.stages]
        return self.learner.probabilities(np.reshape(firmness, (-1, 1)))[:, order]

    def find_boundary(self, stage: str) -> float:
        """Return the firmness below which this or a softer stage is more probable.

        Raises `InputError` if `stage` is the first stage or unknown.
        """
        if stage not in self.stages[1:]:
            raise InputError(
                f"{stage!r} is not reached by softening; choose one of: "
                f"{', '.join(self.stages[1:])}"
            )
        # The probability of this or a softer stage rises from 0 to 1 as the firmness falls.
        span = self.course.hard - self.course.soft
        firmness = np.linspace(self.course.hard + span, self.course.soft - span, 601)
        is_softer = self.probabilities(firmness)[:, self.stages.index(stage) :].sum(axis=1)
        return float(firmness[int(np.argmax(is_softer >= 0.5))])

    def judge(self, days: Sequence[DayFirmness], *, ripe: str = RIPE) -> Ripeness:
        """Judge an item on its last day, using all its days."""
        courses, last = self.course.weigh_courses(days), days[-1]
        probabilities = _NODE_WEIGHTS @ self.probabilities(
            last.firmness + self.course.mean_sd(last) * _NODES
        )
        tail = (1.0 - LEVEL) / 2.0
        remaining_days = courses.day_below(self.find_boundary(ripe)) - last.day
        low, value, high = courses.quantile(remaining_days, [tail, 0.5, 1.0 - tail])
        if np.isfinite(value):
            low, high = value - _WIDENING * (value - low), value + _WIDENING * (high - value)
        return Ripeness(
            stage=self.stages[int(np.argmax(probabilities))],
            probabilities=dict(zip(self.stages, probabilities.tolist(), strict=True)),
            firmness=courses.mean_firmness(last.day),
            days_to_ripe=Days(value=float(value), low=float(low), high=float(high)),
            basis="labels",
        )


def learn_stages(
    firmness: Sequence[float], labels: Sequence[str], *, items: Sequence[str], stages: Sequence[str]
) -> LabelLearner:
    """Learn stages from the firmness of labelled days.

    `firmness`, `labels`, `items`: firmness, a person's label and the item's name for each day.
    `stages`: all stages in order, firmest first.
    The result depends neither on the order of the rows nor on the names.
    Raises `InputError` if a label is not a stage, or a stage has no label.
    """
    unknown = sorted(set(labels) - set(stages))
    if unknown:
        raise InputError(
            f"label {unknown[0]!r} is not a stage of ripeness; available: {', '.join(stages)}"
        )
    missing = [stage for stage in stages if stage not in labels]
    if missing:
        raise InputError(
            f"no item is labelled {missing[0]!r}; label at least one item of each stage "
            f"({', '.join(stages)})"
        )
    learner = LabelLearner(allow_unknown=False, methods=["discriminant"])
    return learner.fit(np.reshape(firmness, (-1, 1)), labels, items=items)


def judge_by_first_day(days: Sequence[DayFirmness]) -> Ripeness:
    """Judge an item by its softening since its first day.

    The item is assumed to be hard on that day. Only for fingers driven by width. Days to ripe are
    not available without a course.

    >>> days = [DayFirmness(day=0.0, firmness=2.0, grasps=3, spread=0.1)]
    >>> judge_by_first_day(days).stage
    'hard'
    """
    probabilities = first_day_probabilities(days[-1].firmness, first_firmness=days[0].firmness)
    return Ripeness(
        stage=STAGES[int(np.argmax(probabilities))],
        probabilities=dict(zip(STAGES, probabilities.tolist(), strict=True)),
        firmness=days[-1].firmness,
        days_to_ripe=None,
        basis="first day",
    )
