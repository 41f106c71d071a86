"""What the steps of a closing say of the object."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.estimate.closing_stiffness import FELT
from palpate.estimate.measurement import Measurement
from palpate.grasp.answers import floor_n, measure_object
from palpate.grasp.estimator import ClosingStep, ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.grasp.step_size import force_now


def test_measure_object_step_whose_pixels_cancel_is_not_felt(plan: Plan) -> None:
    steps = tuple(
        ClosingStep(
            closure=20.0 + 0.5 * number,
            touch=Touch(
                time_s=float(number),
                finger_percent=(-20.0, -20.0),
                relative_percent=-20.0,
                reading=reading,
            ),
        )
        for number, reading in enumerate([1.0, 0.0, 2.0, 3.0, 4.0])
    )
    estimate = ContactEstimate(steps=steps, contact_s=0.0, closure=22.0, force_n=2.0)
    estimate.set_force(2.0, 2.2)
    measured = measure_object(estimate, force_now(estimate, plan), plan=plan)
    without = replace(estimate, steps=(steps[0], *steps[2:]))
    alone = measure_object(without, force_now(without, plan), plan=plan)
    assert abs(measured["size_mm"].middle - alone["size_mm"].middle) < 0.3


@pytest.mark.parametrize("readings", [[0.02], [0.02, 0.03]])
def test_measure_object_touch_too_faint_for_a_curve_still_has_a_firmness(
    plan: Plan, readings: list[float]
) -> None:
    steps = tuple(
        ClosingStep(
            closure=20.0 + number,
            touch=Touch(
                time_s=float(number),
                finger_percent=(percent, percent),
                relative_percent=percent,
                reading=reading,
            ),
        )
        for number, (percent, reading) in enumerate(
            [(0.0, 0.0), *((-5.0, reading) for reading in readings)]
        )
    )
    estimate = ContactEstimate(steps=steps, contact_s=0.0, closure=20.0 + len(readings))
    force = Measurement(value=3.0, low=2.0, high=4.0, unit="n", level=0.9)
    found = measure_object(estimate, force, plan=plan)
    stiffness, firmness = found["stiffness_n_per_mm"], found["firmness"]
    assert stiffness.value is None
    unseen_n = FELT * floor_n(plan)
    assert stiffness.low == pytest.approx((2.0 - unseen_n) / len(readings))
    assert firmness.low < firmness.value < firmness.high


def test_measure_object_without_a_step_has_nothing(plan: Plan) -> None:
    force = Measurement(value=0.5, low=0.2, high=1.0, unit="n", level=0.9)
    assert measure_object(ContactEstimate(), force, plan=plan) == {}
