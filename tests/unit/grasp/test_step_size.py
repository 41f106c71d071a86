"""The next closing step, from slope, noise and the damage limit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.factories import closing_steps

from palpate.grasp.estimator import ContactEstimate
from palpate.grasp.plan import Plan
from palpate.grasp.step_size import close_by, slope_n


def stairs(*, force_n: list[float], step_mm: float) -> ContactEstimate:
    """Return the estimate after squeeze steps with these forces."""
    closings = closing_steps(force_n, step_mm=step_mm)
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
