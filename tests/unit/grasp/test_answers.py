"""Size, stiffness and firmness from the steps of a closing."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.factories import closing_steps, touch

from palpate.estimate.closing_curve import CONTACT_SD
from palpate.grasp.answers import floor_n, measure_object
from palpate.grasp.estimator import ClosingStep, ContactEstimate
from palpate.grasp.plan import Plan
from palpate.grasp.step_size import force_now
from palpate.measurement import Measurement


def test_measure_object_ignores_step_with_cancelling_pixels(plan: Plan) -> None:
    steps = closing_steps([1.0, 0.0, 2.0, 3.0, 4.0], step_mm=0.5)
    estimate = ContactEstimate(steps=steps, contact_s=0.0, closure=22.0, force_n=2.0)
    estimate.set_force(2.0, 2.2)
    measured = measure_object(estimate, force_now(estimate, plan), plan=plan)
    without = replace(estimate, steps=(steps[0], *steps[2:]))
    alone = measure_object(without, force_now(without, plan), plan=plan)
    assert abs(measured["size_mm"].middle - alone["size_mm"].middle) < 0.3


@pytest.mark.parametrize("readings", [[0.02], [0.02, 0.03]])
def test_measure_object_faint_contact_has_firmness(plan: Plan, readings: list[float]) -> None:
    untouched = ClosingStep(closure=20.0, touch=touch(0.0, percent=0.0, time_s=0.0))
    steps = (untouched, *closing_steps([0.0, *readings], step_mm=1.0, percent=-5.0)[1:])
    estimate = ContactEstimate(steps=steps, contact_s=0.0, closure=20.0 + len(readings))
    force = Measurement(value=3.0, low=2.0, high=4.0, unit="n", level=0.9)
    found = measure_object(estimate, force, plan=plan)
    stiffness, firmness = found["stiffness_n_per_mm"], found["firmness"]
    assert stiffness.value is None
    if len(readings) == 1:
        # Too few for a curve: bounded by the force and the travel.
        assert stiffness.low == pytest.approx(2.0 - CONTACT_SD * floor_n(plan))
    assert firmness.low < firmness.value < firmness.high
    assert found["size_mm"].low < found["size_mm"].value < found["size_mm"].high


def test_measure_object_without_steps_returns_nothing(plan: Plan) -> None:
    force = Measurement(value=0.5, low=0.2, high=1.0, unit="n", level=0.9)
    assert measure_object(ContactEstimate(), force, plan=plan) == {}
