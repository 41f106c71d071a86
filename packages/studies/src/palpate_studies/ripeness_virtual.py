"""Judge ripening on virtual sensors, with fruit of both generators.

No grasp is simulated. A day's firmness is the truth with three errors: of each grasp, of the fruit
and of the morning. Their sizes were measured on development sensors of the twin (see the ripeness
page). Hundreds of fruits then take seconds, and the study tests the rule of course and stages
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate_station.ripeness.firmness import DayFirmness
from palpate_station.ripeness.rule import RipenessRule
from palpate_station.ripeness.stages import RIPE, STAGES
from palpate_studies.baselines.ripeness_learners import STAGE_LEARNERS, learn_stage, list_day_inputs
from palpate_studies.protocol.paired import difference_of_pairs
from palpate_studies.report import StudyReport, Table
from palpate_studies.ripeness_station import draw_labelled
from palpate_studies.second.fruit import COURSES, other_avocado
from palpate_studies.twin_avocado import Avocado, draw_avocado

#: Seed of the final evaluation. Virtual sensors 0 to 2 were used in development; 94_001 to 94_004
#: were evaluated before the learners became baselines.
SEED = 94_101
#: Mornings, labelled fruits, grasps per day of a labelled fruit and of a judged fruit.
DAYS, LABELLED, LABELLED_GRASPS, GRASPS = 4, 24, 10, 6
#: Errors in ln of the force at 1 mm: of each grasp, of a fruit on all days, of a morning.
_GRASP_SD, _FRUIT_SD, _MORNING_SD = 0.25, 0.07, 0.05
#: Stiffness at one force is proportional to this power of the force at 1 mm (Hertz).
_POWER = 2.0 / 3.0
#: Name -> function from a fruit of the first generator and its number to this generator's.
GENERATORS: Mapping[str, Callable[[Avocado, int], Avocado]] = {
    "first": lambda fruit, number: fruit,
    "all three": lambda fruit, number: other_avocado(fruit, course=COURSES[number % len(COURSES)]),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualDay:
    """One judged fruit on one day.

    Attributes
    ----------
    fruit : str
        Sensor and number of the fruit.
    exact : bool
        Whether palpate's stage is the true stage.
    exact_learned : dict of str to bool
        The same for learners with all days so far as input.
    covered : bool or None
        Whether the interval of the days to ripe covers the truth; None for a ripe fruit.
    """

    fruit: str
    exact: bool
    exact_learned: dict[str, bool]
    covered: bool | None


def report(*, sensors: int, fruits: int) -> StudyReport:
    """Judge fruit with the ripening courses of the first and the second generator."""
    rows = [
        {
            "generator": name,
            **_scores(
                [
                    day
                    for sensor in range(SEED, SEED + sensors)
                    for day in judge_days(make, sensor=sensor, fruits=fruits)
                ]
            ),
        }
        for name, make in GENERATORS.items()
    ]
    return StudyReport(
        name="ripeness",
        title="Ripening with other courses (simulated)",
        provenance=(
            "Simulated. The second generators are described in `palpate_studies.second.fruit` and "
            "were fixed before anything was scored on them.",
            "Virtual sensors with errors as measured on development sensors of the twin; no grasp "
            "is simulated. Each rule is trained on labelled fruit of the generator that it judges.",
        ),
        tables=[
            Table.of(
                "Stage of four exact, %; interval of the days to ripe (0.9)",
                rows,
                {
                    "generator": "{generator}",
                    "fruit days": "{fruit_days}",
                    "palpate": "{exact:.1p}",
                }
                | {name: f"{{exact_learned[{key}]:.1p}}" for key, name in STAGE_LEARNERS.items()}
                | {
                    "wrong: palpate - boosted trees, points (90 %)": "{wrong_less_learned[trees]["
                    "difference]:+.1p} ({wrong_less_learned[trees][low]:+.1p} to "
                    "{wrong_less_learned[trees][high]:+.1p})",
                    "coverage, %": "{coverage:.0p}",
                },
            )
        ],
        payload={"study": "ripeness", "simulated": True, "seed": SEED, "ripeness": rows},
    )


def _scores(days: Sequence[VirtualDay]) -> dict[str, Any]:
    covered = [day.covered for day in days if day.covered is not None]
    learned = {name: [day.exact_learned[name] for day in days] for name in STAGE_LEARNERS}
    return {
        "fruit_days": len(days),
        "exact": float(np.mean([day.exact for day in days])),
        "coverage": float(np.mean(covered)),
        "waiting_days": len(covered),
        "exact_learned": {name: float(np.mean(exact)) for name, exact in learned.items()},
        "wrong_less_learned": {name: _wrong_less(days, exact) for name, exact in learned.items()},
    }


def _wrong_less(days: Sequence[VirtualDay], baseline_exact: Sequence[bool]) -> dict[str, Any]:
    """Compare palpate's fraction of wrong stages with a baseline's, by fruit."""
    return difference_of_pairs(
        [float(not day.exact) for day in days],
        [float(not exact) for exact in baseline_exact],
        [day.fruit for day in days],
        statistic=np.mean,
    ).to_dict()


def judge_days(
    make: Callable[[Avocado, int], Avocado], *, sensor: int, fruits: int
) -> list[VirtualDay]:
    """Train a rule on labelled fruit of a generator, and judge other fruit of it.

    Parameters
    ----------
    make : callable
        From a fruit of the first generator and its number to a fruit of this generator.
    sensor : int
        Seed.
    fruits : int
        Number of fruits to judge, on four days each.
    """
    rng = np.random.default_rng([sensor, 41])
    labelled = draw_labelled(rng, LABELLED, make=make)
    others = [make(draw_avocado(rng), number) for number in range(fruits)]
    mornings = _MORNING_SD * rng.standard_normal(2 * DAYS)
    training_days = [
        _simulate_days(one, rng, mornings[:DAYS], grasps=LABELLED_GRASPS) for one in labelled
    ]
    labels = [[one.stage(day) for day in range(DAYS)] for one in labelled]
    rule = RipenessRule.learn(training_days, labels=labels, stages=STAGES)
    rows = [list_day_inputs(days[: count + 1]) for days in training_days for count in range(DAYS)]
    ranks = [STAGES.index(label) for each in labels for label in each]
    learners = {name: learn_stage(name, rows, ranks) for name in STAGE_LEARNERS}
    found = []
    for number, fruit in enumerate(others):
        days = _simulate_days(fruit, rng, mornings[DAYS:], grasps=GRASPS)
        found += [
            _judge(fruit, days[: count + 1], rule, learners, name=f"{sensor}/{number}")
            for count in range(DAYS)
        ]
    return found


def _simulate_days(
    fruit: Avocado, rng: np.random.Generator, mornings: np.ndarray, *, grasps: int
) -> list[DayFirmness]:
    own = _FRUIT_SD * rng.standard_normal()
    found = []
    for day in range(DAYS):
        each = np.log(fruit.force_at_1mm_n(day)) + own + mornings[day]
        measured = _POWER * (each + _GRASP_SD * rng.standard_normal(grasps))
        found.append(
            DayFirmness(
                day=float(day),
                firmness=float(measured.mean()),
                grasps=grasps,
                spread=float(measured.std(ddof=1)),
            )
        )
    return found


def _judge(
    fruit: Avocado,
    days: Sequence[DayFirmness],
    rule: RipenessRule,
    learners: Mapping[str, Callable[[Sequence[float]], int]],
    *,
    name: str,
) -> VirtualDay:
    last, judged = days[-1], rule.judge(days)
    if judged.days_to_ripe is None:
        raise InputError("the learned rule has no course; label fruit of all stages")
    truth = fruit.stage(last.day)
    wait = fruit.day_of(RIPE) - last.day
    return VirtualDay(
        fruit=name,
        exact=judged.stage == truth,
        exact_learned={
            learner: STAGES[stage(list_day_inputs(days))] == truth
            for learner, stage in learners.items()
        },
        covered=judged.days_to_ripe.low <= wait <= judged.days_to_ripe.high if wait > 0 else None,
    )
