"""Forecast of the settled reading: plausibility and calibrated creep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.conftest import calibrate_once
from tests.factories import draw, grasp_on_twin

from palpate.estimate.sheet_creep import SheetCreep
from palpate.grasp.answers import forecast
from palpate.grasp.estimator import ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.measurement import Status
from palpate.twin.world import World

#: Frames of a reading that falls by a fifth each: drawn out, next to nothing would be left.
FALLING = tuple(30.0 * 0.8**k for k in range(9))
CREEP = SheetCreep(log_mean=0.2, log_sd=0.05, early_s=0.4, settled_s=20.0)


def held(plan: Plan) -> ContactEstimate:
    touches = tuple(
        Touch(
            time_s=0.3 + k / 15,
            finger_percent=(-60.0, -60.0),
            relative_percent=-60.0 - 0.01 * k,
            reading=reading,
        )
        for k, reading in enumerate(FALLING, start=1)
    )
    return ContactEstimate(touches=touches, now_s=touches[-1].time_s, moved_s=0.0)


def test_implausible_forecast_is_replaced_by_the_reading(plan: Plan) -> None:
    time_s = 0.3 + np.arange(1, len(FALLING) + 1) / 15
    found = plan.settling.predict(time_s, np.array([FALLING]), horizon_s=20.0, level=0.9)
    assert found.hold(0).value < 0.5 * FALLING[-1]
    estimate = held(plan)
    reading = forecast(estimate, plan=plan).reading
    assert reading.value == estimate.now.reading
    assert reading.status is Status.FELL_BACK
    assert reading.low <= 0.5 * reading.value
    assert reading.high >= 2.0 * reading.value


def test_forecast_with_sheet_creep_uses_it(plan: Plan) -> None:
    estimate = held(plan)
    reading = forecast(estimate, plan=replace(plan, creep=CREEP)).reading
    assert 1.05 < reading.value / estimate.now.reading < 1.25
    assert reading.high / reading.low < 1.5


@pytest.mark.slow
def test_forecast_of_relative_change_includes_calibrated_creep() -> None:
    """Soft fingers on the twin; a general forecast is 15 to 30 % too large."""
    calibration = calibrate_once(seed=5, level="lab", apart_from="tomato", kind="soft")
    world = World(draw("tomato", 1, 10), seed=1, sheet_seed=5, level="lab", gripper="soft")
    result = grasp_on_twin(world, calibration)
    assert result.settled_percent.value == pytest.approx(world.truth().settled_percent, rel=0.12)
