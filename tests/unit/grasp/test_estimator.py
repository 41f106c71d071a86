"""Memory of the contact estimate in a long hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.grasp import estimator
from palpate.grasp.estimator import ContactEstimate, Observation
from palpate.grasp.plan import Plan


def test_estimate_in_a_long_hold_stores_a_bounded_number_of_readings_and_the_strongest(
    plan: Plan, bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimator, "MOST_TOUCHES", 40)
    state, first = replace(bench.state(), width_mm=50.0), bench.read(timeout_s=1.0)
    estimate = ContactEstimate(rest_ohm=plan.rest_ohm, sent=24.0, still_since_s=0.0, contact_s=0.0)
    for number in range(1, 401):
        counts = first.counts + (50 if number == 2 else 0)
        frame = replace(first, time_s=0.1 * number, sequence=number, counts=counts)
        estimate.update(Observation(frame=frame, gripper=state), plan=plan)
        assert len(estimate.touches) <= 40
    times_s = [touch.time_s for touch in estimate.touches]
    assert times_s[0] == pytest.approx(0.1)
    assert times_s[-20:] == pytest.approx(0.1 * np.arange(381, 401))
    assert (np.diff(times_s) > 0).all()
    assert estimate.strongest_n > max(touch.sheet_n for touch in estimate.touches)
