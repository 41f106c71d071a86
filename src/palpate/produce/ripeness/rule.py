"""The verdict on one item: its stage, the probability, and the days to ripe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.produce.learning import LabelLearner
from palpate.produce.ripeness.course import Course
from palpate.produce.ripeness.firmness import DayFelt
from palpate.produce.ripeness.stages import RIPE, STAGES, own_probabilities

#: A stage that is less probable than this is unsure.
SURE = 0.9
#: Probability that the interval of the days to ripe is meant to cover.
LEVEL = 0.9
#: How much wider it is than the weighed courses give: a few labelled items leave the mean course
#: uncertain, real ones are no logistic curves, rooms are not equally warm on all days. On 322 days
#: of fruit grasped at seven development stations (twelve labelled at each) 1.0 covered 88 %, 1.1 90
#: and 1.2 92 %. At 1.1 only 83 % were covered of 200 further fruits grasped by rigid fingers (soft
#: 91): set to 1.2 in view of those, which covers 87 and 94 % of them.
_WIDER = 1.2
#: Firmness of a day about its mean, standard deviations (Gauss-Hermite).
_NODES, _NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_NODE_WEIGHTS = _NODE_WEIGHTS / _NODE_WEIGHTS.sum()


@dataclass(frozen=True, slots=True, kw_only=True)
class Days:
    """Days until a stage, with their interval; negative once it has passed."""

    #: Median and ends of the interval, days; infinite where it may never come.
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
    #: Of every stage, firmest first.
    probabilities: dict[str, float]
    #: Firmness on that day, by all grasps up to it.
    firmness: float
    #: Until the ripe stage begins; None where no course is known.
    days_to_ripe: Days | None
    #: One of "labels", "first day". What the stages rest on.
    basis: str

    @property
    def unsure(self) -> bool:
        """Whether another grasp on the same day is worth its while."""
        return max(self.probabilities.values()) < SURE


@dataclass(frozen=True, slots=True, kw_only=True)
class RipenessRule:
    """The rule learned for one kind on one rig: stages by labels, days by course.

    A day's firmness alone shows the stage: on fruit of five generators no learner with all
    days so far names more (palpate study ripeness --second).
    """

    #: How it softens.
    course: Course
    #: All stages in order, firmest first.
    stages: tuple[str, ...]
    #: Learns the stage from the firmness of a day.
    learner: LabelLearner

    @classmethod
    def learn(
        cls,
        items: Sequence[Sequence[DayFelt]],
        *,
        labels: Sequence[Sequence[str | None]],
        stages: Sequence[str],
    ) -> RipenessRule:
        """Learn from items grasped over days, some of them labelled.

        `items`: each item's days.
        `labels`: stage of each item on each of its days, where a person gave one.
        `stages`: all stages in order, firmest first.
        Raises `InputError` if there are too few items, a label is no stage, or a stage has no
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
        """Return the firmness below which a stage, or a softer one, is the more probable.

        Raises `InputError` if it is the first stage or none of them.
        """
        if stage not in self.stages[1:]:
            raise InputError(
                f"{stage!r} is not reached by softening; choose one of: "
                f"{', '.join(self.stages[1:])}"
            )
        # From hard to soft the probability of being that soft rises from 0 to 1.
        span = self.course.hard - self.course.soft
        firmness = np.linspace(self.course.hard + span, self.course.soft - span, 601)
        is_softer = self.probabilities(firmness)[:, self.stages.index(stage) :].sum(axis=1)
        return float(firmness[int(np.argmax(is_softer >= 0.5))])

    def judge(self, days: Sequence[DayFelt], *, ripe: str = RIPE) -> Ripeness:
        """Judge an item by its days up to and including the last."""
        courses, last = self.course.courses_of(days), days[-1]
        chance = _NODE_WEIGHTS @ self.probabilities(
            last.firmness + self.course.mean_sd(last) * _NODES
        )
        tail = (1.0 - LEVEL) / 2.0
        wait = courses.day_below(self.find_boundary(ripe)) - last.day
        low, value, high = courses.quantile(wait, [tail, 0.5, 1.0 - tail])
        if np.isfinite(value):
            low, high = value - _WIDER * (value - low), value + _WIDER * (high - value)
        return Ripeness(
            stage=self.stages[int(np.argmax(chance))],
            probabilities=dict(zip(self.stages, chance.tolist(), strict=True)),
            firmness=courses.mean_firmness(last.day),
            days_to_ripe=Days(value=float(value), low=float(low), high=float(high)),
            basis="labels",
        )


def learn_stages(
    firmness: Sequence[float], labels: Sequence[str], *, items: Sequence[str], stages: Sequence[str]
) -> LabelLearner:
    """Learn stages from the firmness of labelled days.

    `firmness`, `labels`, `items`: of each day its firmness, the stage that a person gave, and which
        item it was.
    `stages`: all stages in order, firmest first.
    Raises `InputError` if a label is no stage, or a stage has no label.
    """
    unknown = sorted(set(labels) - set(stages))
    if unknown:
        raise InputError(
            f"label {unknown[0]!r} is no stage of ripeness; there are: {', '.join(stages)}"
        )
    missing = [stage for stage in stages if stage not in labels]
    if missing:
        raise InputError(
            f"no item was ever labelled {missing[0]!r}; label at least one item of each stage "
            f"({', '.join(stages)})"
        )
    learner = LabelLearner(strangers=False, methods=["discriminant"])
    return learner.fit(np.reshape(firmness, (-1, 1)), labels, items=items)


def judge_by_first_day(days: Sequence[DayFelt]) -> Ripeness:
    """Judge an item by its softening since its own first day, taken as hard.

    For fingers driven by width alone. Without a course there are no days to ripe.

    >>> felt = [DayFelt(day=0.0, firmness=2.0, grasps=3, spread=0.1)]
    >>> judge_by_first_day(felt).stage
    'hard'
    """
    chance = own_probabilities(days[-1].firmness, first_firmness=days[0].firmness)
    return Ripeness(
        stage=STAGES[int(np.argmax(chance))],
        probabilities=dict(zip(STAGES, chance.tolist(), strict=True)),
        firmness=days[-1].firmness,
        days_to_ripe=None,
        basis="first day",
    )
