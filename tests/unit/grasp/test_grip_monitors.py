"""Loss of a held object, and readings that do not follow the gripper."""

from __future__ import annotations

import numpy as np
import pytest
from tests.factories import closing_steps, touch

from palpate.grasp.config import GUARDS
from palpate.grasp.estimator import ContactEstimate, Observation
from palpate.grasp.monitors import ResponseMonitor, SlipMonitor
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Danger
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperState
from palpate.sensor.array import Frame

SEEN = Observation(
    frame=Frame(time_s=1.0, sequence=1, counts=np.full((4, 2), 300), oversampling=1),
    gripper=GripperState(time_s=1.0, width_mm=50.0),
)


def held(fraction: float, *, phase: Phase = Phase.HOLD) -> GraspState:
    """Return a grasp with a largest reading of 1 and this present reading."""
    touches = tuple(touch(fraction, time_s=0.1 * number) for number in range(12))
    estimate = ContactEstimate(now_s=1.1, still_since_s=0.0, touches=touches, strongest_reading=1.0)
    return GraspState(phase=phase, estimate=estimate)


@pytest.mark.parametrize("phase", [Phase.SQUEEZE, Phase.SETTLE, Phase.HOLD])
def test_slip_monitor_reading_below_fraction_raises_alarm(plan: Plan, phase: Phase) -> None:
    alarm = SlipMonitor(plan).check(SEEN, held(GUARDS.lost_fraction - 0.02, phase=phase))
    assert alarm.danger is Danger.SLIPPED


def test_slip_monitor_reading_above_fraction_raises_no_alarm(plan: Plan) -> None:
    assert SlipMonitor(plan).check(SEEN, held(GUARDS.lost_fraction + 0.02)) is None


def test_slip_monitor_while_opening_raises_no_alarm(plan: Plan) -> None:
    assert SlipMonitor(plan).check(SEEN, held(0.0, phase=Phase.RELEASE)) is None


def closed(*readings: float) -> GraspState:
    """Return a squeeze with these readings at its steps."""
    estimate = ContactEstimate(
        now_s=9.0, still_since_s=8.9, steps=closing_steps(readings, step_mm=1.0), contact_s=0.0
    )
    return GraspState(phase=Phase.SQUEEZE, estimate=estimate)


@pytest.mark.parametrize(
    ("readings", "is_alarm"),
    [
        ((1.0, 2.0, 1.9, 1.8, 1.7), True),
        ((2.0, 1.9, 1.8, 1.7), True),
        ((1.0, 2.0, 1.9, 1.8), False),
        ((1.0, 2.0, 1.9, 1.8, 1.85), False),
        ((2.0, 1.9, 1.91, 1.8, 1.7), False),
        ((2.0, 1.999, 1.998, 1.997), False),
        ((2.0, 1.9, 1.8, 1.7, 2.1), False),
    ],
)
def test_response_monitor_three_falling_responses_raise_an_alarm(
    plan: Plan, readings: tuple[float, ...], is_alarm: bool
) -> None:
    alarm = ResponseMonitor(plan).check(SEEN, closed(*readings))
    assert (alarm is not None) == is_alarm
    if alarm is not None:
        assert alarm.danger is Danger.UNSEEN_FORCE
