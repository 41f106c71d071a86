"""What the steps of a closing say of the object."""

from __future__ import annotations

from dataclasses import replace

from palpate.grasp.answers import measure_object
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
    assert measured["size_mm"] is not None
    assert abs(measured["size_mm"].middle - alone["size_mm"].middle) < 0.3
