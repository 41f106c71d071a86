"""Safety filter: limits of closing commands, and unchanged opening commands."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.grasp.estimator import ContactEstimate
from palpate.grasp.plan import Plan
from palpate.grasp.safety_filter import filter_command, safe_step, stop_here
from palpate.gripper.interface import GripperCommand


def pressed(force_n: float, **known: float) -> ContactEstimate:
    """Return the estimate at 20 mm closure with a given force."""
    return ContactEstimate(closure=20.0, sent=20.0, force_n=force_n, force_high_n=force_n, **known)


def test_safe_step_subtracts_tracking_lag(plan: Plan) -> None:
    straight, lagging = (
        safe_step(pressed(5.0, tracking_lag=lag_mm), plan) for lag_mm in (0.0, 0.3)
    )
    assert straight == pytest.approx((15.0 - 5.0) / plan.steepest_n)
    assert lagging == pytest.approx(straight - 0.3)


@pytest.mark.parametrize("ceiling_n", [5.2, 6.0, 7.0])
def test_filter_command_shortens_and_slows_unsafe_closing(plan: Plan, ceiling_n: float) -> None:
    low = replace(plan, safety=replace(plan.safety, force_ceiling_n=ceiling_n))
    wish = GripperCommand(target=50.0, rate=8.0)
    command = filter_command(wish, pressed(5.0), low)
    if command is None:
        assert (ceiling_n - 5.0) / plan.steepest_n < plan.smallest_step + plan.resolution
        return
    travel = 54.0 - command.target
    assert 5.0 + travel * plan.steepest_n <= ceiling_n + 1e-9
    assert command.rate == pytest.approx(wish.rate * travel / 4.0)


def test_filter_command_passes_opening_unchanged(plan: Plan) -> None:
    wish = GripperCommand(target=70.0, rate=60.0)
    assert filter_command(wish, pressed(20.0), plan) is wish


def test_stop_here_of_lagging_hand_targets_reported_position(plan: Plan) -> None:
    reported = 20.0 - 0.3
    command = stop_here(pressed(5.0, tracking_lag=0.3), plan)
    assert 0.0 <= command.target - plan.gripper.target(reported) < plan.resolution


def test_filter_command_below_smallest_step_returns_none(plan: Plan) -> None:
    room_mm = 0.8 * plan.smallest_step
    low = replace(
        plan, safety=replace(plan.safety, force_ceiling_n=5.0 + room_mm * plan.steepest_n)
    )
    fine = replace(low, resolution=0.01 * plan.smallest_step)
    assert filter_command(GripperCommand(target=50.0, rate=0.1), pressed(5.0), fine) is None
