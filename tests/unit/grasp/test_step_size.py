"""The next closing step, from slope, noise and the damage limit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.factories import closing_steps, draw, grasp_on_twin

from palpate.estimate.damage import DamageModel
from palpate.grasp.estimator import ClosingStep, ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.grasp.step_size import close_by, slope_n
from palpate.rig.simulated import calibrate_twin
from palpate.twin.world import GripperKind, World


def stairs(*, force_n: list[float], step_mm: float) -> ContactEstimate:
    """Return the estimate after squeeze steps with these forces."""
    closings = closing_steps([2.0 * force for force in force_n], step_mm=step_mm)
    return ContactEstimate(
        steps=closings,
        contact_s=0.0,
        closure=closings[-1].closure,
        sent=closings[-1].closure,
        force_n=force_n[-1],
        force_high_n=1.1 * force_n[-1],
    )


@pytest.mark.parametrize(
    ("force_n", "alone", "slope"),
    [
        # Above the noise it is the steepest of the last two, within the noise an upper bound.
        ([0.8, 1.3, 2.0, 2.5], 0, 1.4),
        ([2.0, 2.06, 2.09, 2.1], 0, 1.1 * 2.1 / 1.5),
        # A travel with one finger in contact counts not at all.
        ([0.9, 0.95, 0.92, 1.0], 3, 1.1 * 1.0 / 0.5),
        ([2.0, 2.6, 2.5], 0, None),
    ],
)
def test_slope_n_is_the_steepest_that_the_steps_allow_or_that_of_a_rigid_object(
    plan: Plan, force_n: list[float], alone: int, slope: float | None
) -> None:
    estimate = stairs(force_n=force_n, step_mm=0.5)
    pushed = tuple(
        replace(step, touch=replace(step.touch, finger_percent=(-40.0, 0.0)))
        for step in estimate.steps[:alone]
    )
    found = slope_n(replace(estimate, steps=(*pushed, *estimate.steps[alone:])), plan)
    assert found == pytest.approx(slope, rel=0.05) if slope else found == plan.steepest_n


@pytest.mark.parametrize("force_n", [0.5, 1.0, 1.9])
def test_close_by_stays_within_bound_above_target(plan: Plan, force_n: float) -> None:
    aimed = replace(plan, target_force_n=2.0)
    estimate = stairs(force_n=[force_n / 4, force_n / 2, force_n], step_mm=0.25)
    wish = close_by(estimate, 20.0, aimed)
    way = 74.0 - wish.target - estimate.closure
    assert force_n + way * slope_n(estimate, aimed) < 1.5 * 2.0 + 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "kind", "rate_hz", "target_n"),
    [
        ("apple", 710092, "rigid", 250.0, 2.0),
        ("avocado-day-3", 710148, "soft", 15.0, 2.0),
        # One finger alone pushed this first.
        ("avocado-day-4", 820045, "rigid", 15.0, 3.0),
    ],
)
def test_run_grasp_with_noise_like_a_slope_stays_near_target(
    name: str, seed: int, kind: GripperKind, rate_hz: float, target_n: float
) -> None:
    """Simulated grasps that once reached two to five times the target."""
    calibration = calibrate_twin(seed=seed, level="field", apart_from=name, kind=kind)
    world = World(
        draw(name, seed, 10),
        seed=seed,
        sheet_seed=seed,
        level="field",
        gripper=kind,
        frame_rate_hz=rate_hz,
    )
    grasp_on_twin(world, calibration, target_force_n=target_n)
    assert world.truth().peak_force_n <= 1.5 * target_n + 0.5


def felt(*, first: float, second: float, force_n: float) -> ContactEstimate:
    """Return the estimate after a 1 mm step with these finger changes."""
    touch = Touch(
        time_s=1.0,
        finger_percent=(first, second),
        relative_percent=(first + second) / 2,
        reading=2.0 * force_n,
    )
    stairs = tuple(ClosingStep(closure=20.0 + 0.25 * each, touch=touch) for each in range(5))
    return ContactEstimate(closure=21.0, sent=21.0, steps=stairs, force_high_n=1.5 * force_n)


@pytest.mark.parametrize(
    ("first", "second", "force_n", "goes_on"),
    [
        (-5.0, -0.2, 0.9, True),  # one finger alone pushes the object to the middle
        (-5.0, -2.0, 0.9, False),  # both feel it: it is squeezed
        (-5.0, -0.2, 1.2, False),  # so much that no push takes it
    ],
)
def test_squeeze_depth_ignores_one_finger_alone(
    plan: Plan, damage: DamageModel, first: float, second: float, force_n: float, goes_on: bool
) -> None:
    careful = replace(plan, damage=damage, target_force_n=4.0)
    estimate = felt(first=first, second=second, force_n=force_n)
    assert (close_by(estimate, 0.25, careful) is not None) == goes_on
