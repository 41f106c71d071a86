"""Ripening judged on virtual sensors: fruit of either generator, errors as large as the twin's.

No grasp is simulated: a day's firmness is the truth with three errors on it, of each grasp, of the
fruit and of the morning, as large as those measured on development sensors of the twin (see the
ripeness page). So hundreds of fruits of several generators take seconds, and what is tested is the
rule of course and stages alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.errors import InputError
from palpate.produce.ripeness.firmness import DayFelt
from palpate.produce.ripeness.rule import RipenessRule
from palpate.produce.ripeness.stages import RIPE, STAGES, Boundaries
from palpate_studies.baselines.ripeness_learners import STAGE_LEARNERS, learned_stage, numbers_of
from palpate_studies.twin_avocado import Avocado, draw_avocado

#: Mornings, labelled fruits and grasps of each on a day, and grasps of those that are judged.
DAYS, LABELLED, LABELLED_GRASPS, GRASPS = 4, 24, 10, 6
#: Errors in ln of the force at 1 mm: from grasp to grasp, of a fruit on all days, of a morning.
_GRASP_SD, _FRUIT_SD, _MORNING_SD = 0.25, 0.07, 0.05
#: Stiffness at one force goes with this power of the force at 1 mm (Hertz).
_POWER = 2.0 / 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualDay:
    """One judged fruit on one day.

    Attributes
    ----------
    fruit : str
        Sensor and number of the fruit.
    exact, exact_one_day : bool
        Whether ours, and thresholds on that day's firmness alone, named the true stage.
    exact_learned : dict of str to bool
        The same of learners that are shown all days up to that one.
    covered : bool or None
        Whether the interval of the days to ripe holds the truth; None where it is ripe already.
    """

    fruit: str
    exact: bool
    exact_one_day: bool
    exact_learned: dict[str, bool]
    covered: bool | None


def judged_days(
    make: Callable[[Avocado, int], Avocado], *, sensor: int, fruits: int
) -> list[VirtualDay]:
    """Teach one virtual sensor with labelled fruit of a generator, and judge others of it.

    Parameters
    ----------
    make : callable
        Fruit of the first generator, and its number -> fruit of this one.
    sensor : int
        Seed.
    fruits : int
        How many are judged, four days each.
    """
    rng = np.random.default_rng([sensor, 41])
    labelled = _shown(make, rng)
    others = [make(draw_avocado(rng), number) for number in range(fruits)]
    mornings = _MORNING_SD * rng.standard_normal(2 * DAYS)
    taught = [_felt(one, rng, mornings[:DAYS], grasps=LABELLED_GRASPS) for one in labelled]
    labels = [[one.stage(day) for day in range(DAYS)] for one in labelled]
    rule = RipenessRule.learn(taught, labels=labels, stages=STAGES)
    single = Boundaries.learn(
        [day.firmness for days in taught for day in days],
        [label for each in labels for label in each],
    )
    rows = [numbers_of(days[: count + 1]) for days in taught for count in range(DAYS)]
    ranks = [STAGES.index(label) for each in labels for label in each]
    learners = {name: learned_stage(name, rows, ranks) for name in STAGE_LEARNERS}
    found = []
    for number, fruit in enumerate(others):
        days = _felt(fruit, rng, mornings[DAYS:], grasps=GRASPS)
        found += [
            _judged(fruit, days[: count + 1], rule, single, learners, name=f"{sensor}/{number}")
            for count in range(DAYS)
        ]
    return found


def _shown(make: Callable[[Avocado, int], Avocado], rng: np.random.Generator) -> list[Avocado]:
    """Draw fruit to label until every stage was shown."""
    drawn = [make(draw_avocado(rng), number) for number in range(LABELLED)]
    while {one.stage(day) for one in drawn for day in range(DAYS)} != set(STAGES):
        drawn.append(make(draw_avocado(rng), len(drawn)))
    return drawn


def _felt(
    fruit: Avocado, rng: np.random.Generator, mornings: np.ndarray, *, grasps: int
) -> list[DayFelt]:
    own = _FRUIT_SD * rng.standard_normal()
    found = []
    for day in range(DAYS):
        each = np.log(fruit.force_at_1mm_n(day)) + own + mornings[day]
        felt = _POWER * (each + _GRASP_SD * rng.standard_normal(grasps))
        found.append(
            DayFelt(
                day=float(day),
                firmness=float(felt.mean()),
                grasps=grasps,
                spread=float(felt.std(ddof=1)),
            )
        )
    return found


def _judged(
    fruit: Avocado,
    days: Sequence[DayFelt],
    rule: RipenessRule,
    single: Boundaries,
    learners: Mapping[str, Callable[[Sequence[float]], int]],
    *,
    name: str,
) -> VirtualDay:
    last, judged = days[-1], rule.judge(days)
    if judged.days_to_ripe is None:
        raise InputError("a rule from labels always knows the course")
    truth = fruit.stage(last.day)
    wait = fruit.day_of(RIPE) - last.day
    one_day = STAGES[int(np.argmax(single.probabilities(last.firmness)))]
    return VirtualDay(
        fruit=name,
        exact=judged.stage == truth,
        exact_one_day=one_day == truth,
        exact_learned={
            learner: STAGES[stage(numbers_of(days))] == truth for learner, stage in learners.items()
        },
        covered=judged.days_to_ripe.low <= wait <= judged.days_to_ripe.high if wait > 0 else None,
    )
