"""Corrections of the settled force: closing further, or opening and closing again."""

from __future__ import annotations

import pytest

from palpate.grasp.estimator import ClosingStep, ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.grasp.settle import increase_force, reduce_force, return_from_below
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement

#: The object of these tests raises the force by this much per millimetre.
N_PER_MM = 2.0


def touch(force_n: float) -> Touch:
    """Return the sheet's reading at a force, with twice the excess conductance."""
    return Touch(
        time_s=1.0, finger_percent=(-30.0, -30.0), relative_percent=-30.0, reading=2.0 * force_n
    )


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


def test_increase_force_adds_the_missing_force(plan: Plan) -> None:
    state = holding(4.0)
    wish = increase_force(state, settled(4.0), plan, force_deficit_n=1.0)
    assert plan.gripper.highest - wish.target == pytest.approx(21.0 + 1.0 / N_PER_MM, abs=0.05)
    assert state.correction.count == 1
    assert state.correction.before == (21.0, pytest.approx(4.0))


def test_increase_force_after_small_effect_lowers_slope_to_a_quarter(
    plan: Plan,
) -> None:
    """0.5 mm added 0.1 N instead of 1 N; the next step is quadrupled."""
    state = holding(4.0)
    state.correction.before = (20.5, 3.9)
    wish = increase_force(state, settled(4.0), plan, force_deficit_n=0.2)
    assert plan.gripper.highest - wish.target == pytest.approx(
        21.0 + 0.2 / (N_PER_MM / 4.0), abs=0.05
    )


def test_increase_force_after_ineffective_step_limits_step_to_previous_travel(plan: Plan) -> None:
    state = holding(4.0)
    state.correction.before = (20.9, 4.1)
    wish = increase_force(state, settled(4.0), plan, force_deficit_n=3.0)
    assert plan.gripper.highest - wish.target == pytest.approx(21.1, abs=0.03)


def test_increase_force_without_safe_step_changes_nothing(plan: Plan) -> None:
    state = holding(4.0)
    state.estimate.damage_low_n = 4.1
    assert increase_force(state, settled(4.0), plan, force_deficit_n=3.0) is None
    assert (state.correction.count, state.estimate.force_n) == (0, 4.0)


def test_reduce_force_opens_well_below_target(plan: Plan) -> None:
    state = holding(5.0)
    command = reduce_force(state, settled(5.0), plan, goal_n=4.0)
    over_n = 5.0 - 4.0
    closure = 21.0 - over_n / N_PER_MM
    assert state.correction.return_closure == pytest.approx(closure, abs=0.05)
    opened = closure - 0.3 * 4.0 / N_PER_MM - plan.backlash
    assert plan.gripper.highest - command.target == pytest.approx(opened, abs=0.05)
    assert state.estimate.force_n == pytest.approx(0.7 * 4.0)
    assert state.correction.next_forecast_s == 0.0
    assert state.correction.count == 1


def below(force_n: float, *, return_closure: float) -> GraspState:
    state = holding(force_n)
    state.correction.return_closure = return_closure
    state.estimate.force_n = state.estimate.force_high_n = 0.1
    return state


def test_return_from_below_takes_half_a_second(plan: Plan) -> None:
    state = below(3.0, return_closure=22.0)
    wish = return_from_below(state, plan)
    assert plan.gripper.highest - wish.target == pytest.approx(22.0, abs=0.05)
    assert wish.rate == pytest.approx(1.0 / 0.5)
    assert state.estimate.force_n == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("return_closure", [21.0, 22.0])
def test_return_from_below_waits_for_reading_and_ends_at_closure(
    plan: Plan, return_closure: float
) -> None:
    state = below(3.0, return_closure=return_closure)
    if return_closure > 21.0:
        state.estimate.touches = ()
    assert return_from_below(state, plan) is None
    assert state.estimate.force_n == 0.1
