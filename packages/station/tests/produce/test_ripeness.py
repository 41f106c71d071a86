"""Ripeness: firmness of grasps, courses, stages and verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from packages.station.tests.factories import make_grasp

from palpate.errors import InputError
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate.object.firmness import firmness_index
from palpate_station.records import Grasp
from palpate_station.ripeness.course import Course
from palpate_station.ripeness.firmness import DayFirmness, firmness_of, group_by_day
from palpate_station.ripeness.history import (
    firmness_history,
    judge_ripeness,
    learn_rule,
)
from palpate_station.ripeness.rule import RipenessRule, judge_by_first_day, learn_stages
from palpate_station.ripeness.stages import STAGES
from palpate_station.store import Store

FIRST = datetime(2026, 5, 4, 8, tzinfo=UTC)
#: Course of the simulated items: stiffness falls from 6 to 1 N/mm; boundaries in N/mm.
HARD, SOFT, BOUNDS = math.log(6.0), math.log(1.0), (4.5, 2.5, 1.5)


def grasp(item_id: str, stiffness: float, *, day: float = 0.0, force_n: float = 5.0) -> Grasp:
    def measured(value: float, unit: str) -> Measurement:
        return Measurement(value=value, low=0.9 * value, high=1.1 * value, unit=unit)

    return make_grasp(
        item_id,
        taken_at=FIRST + timedelta(days=day),
        measurements={
            "firmness": firmness_index(measured(stiffness, "n_per_mm")),
            "force_n": measured(force_n, "n"),
            "width_mm": measured(60.0, "mm"),
        },
    )


def soft_grasp(*pixels: float) -> Grasp:
    return make_grasp("soft", drive="pressure", pixel_settled_percent=(pixels,))


def firmness(halfway: float, day: float) -> float:
    return SOFT + (HARD - SOFT) / (1.0 + math.exp((day - halfway) / 0.8))


def stage(value: float) -> str:
    return STAGES[sum(value < math.log(bound) for bound in BOUNDS)]


def morning(day: float, value: float, *, grasps: int = 2, spread: float = 0.05) -> DayFirmness:
    return DayFirmness(day=day, firmness=value, grasps=grasps, spread=spread)


def softening_days(halfway: float, days: Iterable[int], *, rng: Any = None) -> list[DayFirmness]:
    """Return days of two grasps of an item that is half softened on day `halfway`."""
    noise = rng.normal if rng else lambda *_: 0.0
    return [morning(float(day), firmness(halfway, day) + noise(0.0, 0.05)) for day in days]


def simulate_items(count: int, *, seed: int) -> tuple[list[float], list[list[DayFirmness]]]:
    rng = np.random.default_rng(seed)
    halfway = rng.uniform(0.5, 4.5, count).tolist()
    return halfway, [softening_days(half, range(6), rng=rng) for half in halfway]


@pytest.fixture(scope="module")
def rule() -> RipenessRule:
    halfway, items = simulate_items(8, seed=1)
    labels = [[stage(firmness(half, d)) for d in range(6)] for half in halfway]
    return RipenessRule.learn(items, labels=labels, stages=STAGES)


def test_firmness_of_round_body_is_independent_of_force() -> None:
    # Hertz: with eight times the force, the same fruit is twice as stiff.
    soft, pressed = grasp("a", 2.0, force_n=5.0), grasp("a", 4.0, force_n=40.0)
    assert firmness_of(soft) == pytest.approx(firmness_of(pressed))


def test_firmness_of_grasp_counts_at_its_own_force_and_not_at_the_grip_force() -> None:
    squeezed = replace(grasp("a", 2.0, force_n=40.0), firmness_force_n=5.0)
    assert firmness_of(squeezed) == pytest.approx(firmness_of(grasp("a", 2.0, force_n=5.0)))


def test_firmness_of_unloaded_or_slipped_grasp_is_none() -> None:
    assert firmness_of(soft_grasp(0.0, 1.0, -0.5, 0.0)) is None
    assert firmness_of(make_grasp(outcome=Outcome.SLIPPED)) is None


def test_group_by_day_earlier_morning_is_a_separate_day() -> None:
    times = [0.0, 0.01, 0.9, 0.95, 2.1]
    days = group_by_day((FIRST + timedelta(days=at), 1.0) for at in times)
    assert [day.grasps for day in days] == [2, 2, 1]
    # The mean is that of the softness.
    (found,) = group_by_day((FIRST, math.log(value)) for value in (2.0, 2.0, 1e6))
    assert math.exp(found.firmness) == pytest.approx(3.0, rel=1e-4)


@pytest.mark.slow
def test_rule_learn_recovers_the_course_and_the_boundaries(rule: RipenessRule) -> None:
    assert (rule.course.hard, rule.course.soft) == pytest.approx((HARD, SOFT), abs=0.15)
    assert rule.course.pace_days == pytest.approx(0.8, rel=0.35)
    boundaries = np.exp([rule.find_boundary(stage) for stage in STAGES[1:]])
    assert boundaries == pytest.approx(BOUNDS, rel=0.12)


@pytest.mark.slow
def test_judge_new_items_has_correct_stages_and_coverage(rule: RipenessRule) -> None:
    halfway, items = simulate_items(25, seed=2)
    ripe = math.log(BOUNDS[1])
    exact, covered = [], []
    for half, days in zip(halfway, items, strict=True):
        crossing = half + 0.8 * math.log((HARD - SOFT) / (ripe - SOFT) - 1.0)
        for count in range(1, 7):
            judged = rule.judge(days[:count])
            exact.append(judged.stage == stage(firmness(half, count - 1)))
            wait = crossing - (count - 1)
            if wait > 0:
                covered.append(judged.days_to_ripe.low <= wait <= judged.days_to_ripe.high)
    assert np.mean(exact) > 0.88
    assert np.mean(covered) > 0.8


@pytest.mark.slow
def test_judge_more_days_narrow_the_interval_and_an_outlier_does_not_change_the_stage(
    rule: RipenessRule,
) -> None:
    first, last = (rule.judge(softening_days(4.0, range(count))).days_to_ripe for count in (1, 4))
    assert last.high - last.low < 0.7 * (first.high - first.low)
    usual = softening_days(2.0, range(5))
    outlier = morning(2.0, HARD + 1.0, grasps=1, spread=math.nan)
    assert rule.judge([*usual[:2], outlier, *usual[3:]]).stage == rule.judge(usual).stage


def test_judge_by_first_day_uses_softening_since_then() -> None:
    days = [morning(0.0, 2.0)]
    assert judge_by_first_day(days).stage == "hard"
    judged = judge_by_first_day([*days, morning(3.0, 2.0 + math.log(0.25))])
    assert (judged.stage, judged.days_to_ripe, judged.basis) == ("ripe", None, "first day")


def learn(labels: Sequence[str], values: Sequence[float] = (2.0, 1.0, 0.5)) -> None:
    learn_stages(values[: len(labels)], labels, items="abc"[: len(labels)], stages=STAGES)


def test_ripeness_without_enough_days_labels_or_firmness_raises() -> None:
    two_days = [softening_days(2.0, range(2)) for _ in range(5)]
    with pytest.raises(InputError, match=r"0 items were grasped on 3 days or more.*requires 4"):
        Course.learn(two_days)
    with pytest.raises(InputError, match="no item is labelled 'overripe'"):
        learn(["hard", "conditioned", "ripe"])
    with pytest.raises(InputError, match="label 'mushy' is not a stage of ripeness"):
        learn(["mushy"])
    with pytest.raises(InputError, match="no mango has both a ripeness label and a grasp"):
        learn_rule(Store.open("sqlite://"), kind="mango", drive="width", stages=STAGES)
    with pytest.raises(InputError, match="no grasp measured its firmness"):
        judge_ripeness(firmness_history((), item_id="A18", drive="width"), rule=None, ripe="ripe")


@pytest.mark.slow
def test_rule_depends_neither_on_the_order_of_the_items_nor_on_their_names() -> None:
    halfway, items = simulate_items(8, seed=1)
    # Labels of a person near the boundaries, so that the folds decide on the power.
    labels = [[stage(firmness(half, d) + 0.2 * (-1) ** d) for d in range(6)] for half in halfway]
    orders = [range(8), [3, 7, 0, 5, 1, 6, 2, 4], range(7, -1, -1)]
    rules = [
        RipenessRule.learn(
            [items[k] for k in order], labels=[labels[k] for k in order], stages=STAGES
        )
        for order in orders
    ]
    days = softening_days(2.6, range(4))
    first, *others = (rule.judge(days) for rule in rules)
    assert others == [first, first]
