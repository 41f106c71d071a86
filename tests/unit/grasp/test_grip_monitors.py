"""Loss of a held object, and readings that do not follow the gripper."""

from __future__ import annotations

import numpy as np
import pytest
from tests.factories import closing_steps, touch

from palpate.grasp.config import GUARDS
from palpate.grasp.estimator import ContactEstimate, Observation, Touch
from palpate.grasp.monitors import FingersMonitor, ResponseMonitor, SlipMonitor
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Danger
from palpate.grasp.state import Correction, GraspState
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


def one_finger(phase: Phase, *, other_percent: float) -> GraspState:
    """Return a grasp in which finger 1 is pressed, and finger 0 reads this change."""
    touches = tuple(
        Touch(
            time_s=0.1 * number,
            finger_percent=(other_percent, -40.0),
            relative_percent=-20.0,
            reading=1.0,
        )
        for number in range(12)
    )
    return GraspState(
        phase=phase, estimate=ContactEstimate(now_s=9.0, still_since_s=0.0, touches=touches)
    )


@pytest.mark.parametrize(
    ("phase", "other_percent", "is_alarm"),
    [
        (Phase.SQUEEZE, 0.0, True),
        (Phase.HOLD, 0.0, True),
        (Phase.HOLD, -30.0, False),
        (Phase.APPROACH, 0.0, False),
        (Phase.RELEASE, 0.0, False),
    ],
)
def test_fingers_monitor_grip_of_one_finger_alone_raises_an_alarm_while_holding(
    plan: Plan, phase: Phase, other_percent: float, is_alarm: bool
) -> None:
    alarm = FingersMonitor(plan).check(SEEN, one_finger(phase, other_percent=other_percent))
    assert (alarm is not None) == is_alarm
    if alarm is not None:
        assert alarm.danger is Danger.SENSOR_LOST
        assert "finger 1 measures a grip force and the other finger none" in alarm.message


@pytest.mark.parametrize(
    ("activity", "opened_mm", "reading", "still_s", "is_alarm"),
    [
        (Activity.EASE, 1.0, 2.5, 5.0, True),
        (Activity.EASE, 1.0, 1.5, 5.0, False),
        (Activity.EASE, 0.0, 2.5, 5.0, False),
        (Activity.EASE, 1.0, 2.5, 0.0, False),
        (Activity.FORECAST, 1.0, 2.5, 5.0, False),
    ],
)
def test_response_monitor_rise_after_opening_raises_an_alarm(
    plan: Plan,
    activity: Activity,
    opened_mm: float,
    reading: float,
    still_s: float,
    is_alarm: bool,
) -> None:
    steps = closing_steps((1.0, 2.0), step_mm=1.0)
    estimate = ContactEstimate(
        now_s=9.0,
        still_since_s=9.0 - still_s,
        steps=steps,
        contact_s=0.0,
        closure=steps[-1].closure - opened_mm,
        touches=tuple(touch(reading, time_s=8.0 + 0.1 * number) for number in range(10)),
    )
    state = GraspState(
        phase=Phase.SETTLE, estimate=estimate, correction=Correction(activity=activity)
    )
    assert (ResponseMonitor(plan).check(SEEN, state) is not None) == is_alarm
