"""Corrections of the settled force by closing further."""

from __future__ import annotations

import pytest
from tests.factories import touch

from palpate.grasp.estimator import ClosingStep, ContactEstimate
from palpate.grasp.plan import Plan
from palpate.grasp.settle import increase_force
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement

#: The object of these tests raises the force by this much per millimetre.
N_PER_MM = 2.0


def settled(force_n: float) -> Measurement:
    return Measurement(value=force_n, low=0.9 * force_n, high=1.1 * force_n, unit="n", level=0.9)


def holding(force_n: float) -> GraspState:
    """Return the state after a squeeze with a known settled force."""
    closures = (20.0, 20.5, 21.0)
    steps = tuple(
        ClosingStep(closure=each, touch=touch(force_n - N_PER_MM * (21.0 - each)))
        for each in closures
    )
    estimate = ContactEstimate(
        closure=21.0,
        sent=21.0,
        steps=steps,
        touches=(touch(force_n),),
        force_n=force_n,
        force_high_n=1.1 * force_n,
        contact_s=0.5,
    )
    return GraspState(estimate=estimate)


@pytest.mark.parametrize(
    ("before", "deficit_n", "closure"),
    [
        (None, 1.0, 21.0 + 1.0 / N_PER_MM),
        # 0.5 mm added 0.1 N instead of 1 N: the slope is lowered to a quarter, not to a tenth.
        ((20.5, 3.9), 0.2, 21.0 + 0.2 / (N_PER_MM / 4.0)),
        # A step without effect is not repeated with a longer one.
        ((20.9, 4.1), 3.0, 21.1),
    ],
)
def test_increase_force_steps_by_the_slope_as_far_as_the_last_step_showed_it(
    plan: Plan, before: tuple[float, float] | None, deficit_n: float, closure: float
) -> None:
    state = holding(4.0)
    state.correction.before = before
    wish = increase_force(state, settled(4.0), plan, by_n=deficit_n)
    assert plan.gripper.highest - wish.target == pytest.approx(closure, abs=0.03)


def test_increase_force_without_safe_step_changes_nothing(plan: Plan) -> None:
    state = holding(4.0)
    state.estimate.damage_low_n = 4.1
    assert increase_force(state, settled(4.0), plan, by_n=3.0) is None
    assert (state.correction.count, state.estimate.force_n) == (0, 4.0)
