"""Safety filter: limits of closing commands, and unchanged opening commands."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.factories import closing_steps

from palpate.grasp.answers import sheet_forces_n
from palpate.grasp.config import SQUEEZE
from palpate.grasp.estimator import ContactEstimate
from palpate.grasp.plan import Plan
from palpate.grasp.safety_filter import filter_command, quantize_target, safe_step, stop_here
from palpate.gripper.interface import GripperCommand, GripperLimits
from palpate.object.compliance import SoftFingerCompliance
from palpate.object.damage import DamageModel


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


@pytest.mark.parametrize("target_mm", [70.0, 54.0])
def test_filter_command_passes_opening_and_stop_unchanged(plan: Plan, target_mm: float) -> None:
    wish = GripperCommand(target=target_mm, rate=60.0)
    assert filter_command(wish, pressed(20.0), plan) is wish


def test_filter_command_of_fully_closed_hand_returns_none(plan: Plan) -> None:
    closed = ContactEstimate(closure=plan.gripper.span, sent=plan.gripper.span)
    assert filter_command(GripperCommand(target=0.0, rate=8.0), closed, plan) is None


def test_filter_command_subtracts_travel_during_latency(plan: Plan) -> None:
    """The travel during the latency is half of the commanded 0.8 mm."""
    fine = replace(plan, resolution=1e-4, safety=replace(plan.safety, force_ceiling_n=7.0))
    wish = GripperCommand(target=54.0 - 0.8, rate=0.4 / plan.safety.latency_s)
    command = filter_command(wish, pressed(5.0), fine)
    assert command is not None
    safe = 2.0 / plan.steepest_n
    assert 54.0 - command.target == pytest.approx(safe / 1.5, abs=1e-4)


@pytest.mark.parametrize("slowest", [0.0, 20.0])
def test_filter_command_leaves_room_for_a_hand_that_cannot_move_slowly(
    plan: Plan, slowest: float
) -> None:
    """The hand overruns at its slowest speed, which is faster than the shortened movement."""
    safety = replace(plan.safety, force_ceiling_n=8.0)
    hand = replace(plan.gripper, slowest=slowest)
    slow = replace(plan, resolution=1e-4, safety=safety, gripper=hand)
    command = filter_command(GripperCommand(target=50.0, rate=1e-3), pressed(5.0), slow)
    assert command is not None
    assert command.rate >= slowest
    safe_mm = 3.0 / plan.steepest_n - slowest * safety.latency_s
    assert 54.0 - command.target == pytest.approx(safe_mm, abs=1e-3)


@pytest.mark.parametrize(
    ("force_n", "percent", "limit_n", "is_short"),
    [
        (0.5, -1.0, None, True),
        # One finger pushes the object to the middle.
        (0.5, -0.9, None, False),
        (1.1, -0.9, None, True),
        # Drift can resemble this force.
        (0.2, -1.0, None, False),
        # The damage limit is known.
        (0.5, -1.0, 30.0, False),
    ],
)
def test_filter_command_before_known_damage_limit_shortens_travel_from_contact(
    plan: Plan,
    damage: DamageModel,
    force_n: float,
    percent: float,
    limit_n: float | None,
    is_short: bool,
) -> None:
    """The force on the softest fruit rises by 0.3 N within this travel."""
    steps = closing_steps((0.0, force_n, force_n), step_mm=0.1, percent=percent)
    estimate = ContactEstimate(closure=20.2, sent=20.2, steps=steps)
    estimate.damage_low_n = estimate.damage_low_n if limit_n is None else limit_n
    fine, wish = replace(plan, resolution=1e-4), GripperCommand(target=53.0, rate=1.0)
    longest = 2 * SQUEEZE.min_rise_n * (1 / plan.steepest_n + 1 / SQUEEZE.soft_n_per_mm)
    assert filter_command(wish, estimate, fine).target == pytest.approx(53.0)
    careful = filter_command(wish, estimate, replace(fine, damage=damage))
    expected_mm = 74.0 - (20.1 + longest) if is_short else 53.0
    assert careful.target == pytest.approx(expected_mm, abs=2e-4)


def test_filter_command_before_known_damage_limit_counts_the_travel_of_soft_fingers(
    plan: Plan, damage: DamageModel
) -> None:
    """A drive that closes 2 mm per unit needs half of the travel on the softest fruit."""
    assert plan.compliance is not None
    bend = SoftFingerCompliance(mm_per_kpa=2.0, compliance=plan.compliance)
    soft = replace(plan, damage=damage, resolution=1e-4, bend=bend)
    steps = closing_steps((0.0, 0.5, 0.5), step_mm=0.1, percent=-1.0)
    estimate = ContactEstimate(closure=20.2, sent=20.2, steps=steps)
    command = filter_command(GripperCommand(target=53.0, rate=1.0), estimate, soft)
    longest = 2 * SQUEEZE.min_rise_n * (1 / plan.steepest_n + 1 / (2 * SQUEEZE.soft_n_per_mm))
    assert command.target == pytest.approx(74.0 - (20.1 + longest), abs=2e-4)


def test_filter_command_force_at_the_limit_of_a_push_does_not_shorten_the_travel(
    plan: Plan, damage: DamageModel
) -> None:
    steps = closing_steps((0.0, 1.1, 1.1), step_mm=0.1, percent=-0.9)
    estimate = ContactEstimate(closure=20.2, sent=20.2, steps=steps)
    limit_n = float(sheet_forces_n(steps, estimate)[-1])
    plan = replace(plan, damage=damage, resolution=1e-4, gentle_force_n=2.0 * limit_n)
    command = filter_command(GripperCommand(target=53.0, rate=1.0), estimate, plan)
    assert command.target == pytest.approx(53.0)


@pytest.mark.parametrize(
    ("drive", "within", "target"),
    [
        ("width", False, 54.0),
        ("width", True, 54.05),
        ("pressure", False, 20.0),
        ("pressure", True, 19.95),
    ],
)
def test_quantize_target_rounds_to_nearest_step_or_towards_open(
    plan: Plan, drive: str, within: bool, target: float
) -> None:
    if drive == "pressure":
        limits = GripperLimits(drive="pressure", lowest=0.0, highest=50.0, fastest=40.0)
        plan = replace(plan, gripper=limits)
    options = {"within": True} if within else {}
    assert quantize_target(19.99, plan, **options) == pytest.approx(target)


@pytest.mark.parametrize("lag_mm", [0.3, 0.01])
def test_stop_here_of_lagging_hand_targets_reported_position(plan: Plan, lag_mm: float) -> None:
    reported = 20.0 - lag_mm
    command = stop_here(pressed(5.0, tracking_lag=lag_mm), plan)
    assert 0.0 <= command.target - plan.gripper.target(reported) < plan.resolution


def test_filter_command_below_smallest_step_returns_none(plan: Plan) -> None:
    room_mm = 0.8 * plan.smallest_step
    low = replace(
        plan, safety=replace(plan.safety, force_ceiling_n=5.0 + room_mm * plan.steepest_n)
    )
    fine = replace(low, resolution=0.01 * plan.smallest_step)
    assert filter_command(GripperCommand(target=50.0, rate=0.1), pressed(5.0), fine) is None
