"""Memory of the contact estimate in a long hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.grasp import estimator
from palpate.grasp.estimator import ContactEstimate, Observation
from palpate.grasp.plan import Plan

from .conftest import REST_OHM, Bench


@pytest.fixture
def holding(plan: Plan) -> tuple[ContactEstimate, Observation]:
    """An estimate with rest values, and the observation of a hand that holds still."""
    bench = Bench()
    state = replace(bench.state(), width_mm=50.0)
    estimate = ContactEstimate(
        rest_ohm=np.full((4, 2), REST_OHM), sent=24.0, still_since_s=0.0, contact_s=0.0
    )
    return estimate, Observation(frame=bench.read(timeout_s=1.0), gripper=state)


def test_estimate_in_a_long_hold_stores_a_bounded_number_of_readings(
    holding: tuple[ContactEstimate, Observation], plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimator, "MOST_TOUCHES", 40)
    estimate, seen = holding
    largest = 0
    for number in range(1, 401):
        frame = replace(seen.frame, time_s=0.1 * number, sequence=number)
        estimate.update(replace(seen, frame=frame), plan=plan)
        largest = max(largest, len(estimate.touches))
    assert largest == 40
    times_s = [touch.time_s for touch in estimate.touches]
    assert times_s[0] == pytest.approx(0.1)
    assert times_s[-20:] == pytest.approx(0.1 * np.arange(381, 401))
    assert (np.diff(times_s) > 0).all()


def test_strongest_reading_outlives_the_thinned_readings(
    holding: tuple[ContactEstimate, Observation], plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimator, "MOST_TOUCHES", 8)
    estimate, seen = holding
    for number in range(1, 100):
        counts = seen.frame.counts + (50 if number == 2 else 0)
        frame = replace(seen.frame, time_s=0.1 * number, sequence=number, counts=counts)
        estimate.update(replace(seen, frame=frame), plan=plan)
    assert estimate.strongest_reading > max(touch.reading for touch in estimate.touches)


def test_confirmed_force_ignores_a_single_spike() -> None:
    estimate = ContactEstimate(frame_forces=((0.0, 1.0), (0.1, 1.0), (0.2, 9.0)))
    assert estimate.confirmed_force_n == 1.0
