"""The verdict on one item: its stage, how sure that is, and when it will be ripe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.produce.ripeness.course import Course
from palpate.produce.ripeness.firmness import DayFelt
from palpate.produce.ripeness.stages import RIPE, Boundaries

#: A stage that is less probable than this is unsure.
SURE = 0.9
#: Probability that the interval of the days to ripe is meant to cover.
LEVEL = 0.9
#: How much wider it is than the weighed courses give: a few labelled items leave the mean course
#: in doubt, real ones are no logistic curves, rooms are not equally warm on all days. On 322 days
#: of fruit felt at seven development stations (twelve labelled at each) 1.0 covered 88 %, 1.1 90
#: and 1.2 92 %. At 1.1 only 83 % were covered of 200 further fruits felt by rigid fingers (soft
#: 91): set to 1.2 in view of those, which covers 87 and 94 % of them.
_WIDER = 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Days:
    """A time to wait, with its interval; 0 and below: that long ago."""

    #: Median and ends of the interval, days; infinite where it may never come.
    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Ripeness:
    """How ripe one item is on one day."""

    #: The most probable stage.
    stage: str
    #: Of every stage, firmest first.
    probabilities: dict[str, float]
    #: Firmness on that day, by all that was felt up to it.
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
    """The rule learned for one kind on one rig."""

    #: How it softens.
    course: Course
    #: Where its stages begin.
    boundaries: Boundaries

    @classmethod
    def learn(
        cls,
        items: Sequence[Sequence[DayFelt]],
        *,
        labels: Sequence[Sequence[str | None]],
        stages: Sequence[str],
    ) -> RipenessRule:
        """Learn from items felt over days, some of which a person labelled.

        `items`: each item's days.
        `labels`: stage of each item on each of its days, where a person gave one.
        `stages`: all stages in order, firmest first.
        Raises `InputError` if there are too few items, or a stage has no label.
        """
        course = Course.learn(items)
        firmness, given = [], []
        for item, names in zip(items, labels, strict=True):
            # Labels are compared with the course of the item, not with a single day's scatter.
            courses = course.courses_of(item)
            for day, name in zip(item, names, strict=True):
                if name is not None:
                    firmness.append(courses.mean_firmness(day.day))
                    given.append(name)
        return cls(course=course, boundaries=Boundaries.learn(firmness, given, stages=stages))

    def judge(self, days: Sequence[DayFelt], *, ripe: str = RIPE) -> Ripeness:
        """Judge an item by its days up to and including the last."""
        courses, last = self.course.courses_of(days), days[-1].day
        now = courses.firmness(last)[:, 0]
        chance = courses.weight @ self.boundaries.probabilities(now)
        tail = (1.0 - LEVEL) / 2.0
        wait = courses.day_below(self.boundaries.begins(ripe)) - last
        low, value, high = courses.quantile(wait, [tail, 0.5, 1.0 - tail])
        if np.isfinite(value):
            low, high = value - _WIDER * (value - low), value + _WIDER * (high - value)
        return Ripeness(
            stage=self.boundaries.stages[int(np.argmax(chance))],
            probabilities=dict(zip(self.boundaries.stages, chance.tolist(), strict=True)),
            firmness=float(courses.weight @ now),
            days_to_ripe=Days(value=float(value), low=float(low), high=float(high)),
            basis="labels",
        )


def judge_by_first_day(days: Sequence[DayFelt]) -> Ripeness:
    """Judge an item by how much it softened since its own first day, taken as hard.

    For fingers driven by width alone. Without a course there are no days to ripe.

    >>> felt = [DayFelt(day=0.0, firmness=2.0, grasps=3, spread=0.1)]
    >>> judge_by_first_day(felt).stage
    'hard'
    """
    boundaries, now = Boundaries.own(days[0].firmness), days[-1].firmness
    chance = boundaries.probabilities(now)
    return Ripeness(
        stage=boundaries.stages[int(np.argmax(chance))],
        probabilities=dict(zip(boundaries.stages, chance.tolist(), strict=True)),
        firmness=now,
        days_to_ripe=None,
        basis="first day",
    )
