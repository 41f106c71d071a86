"""Loss of a held object, and readings that do not follow the gripper."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.factories import closing_steps, touch

from palpate.grasp.config import READING
from palpate.grasp.estimator import ClosingStep, ContactEstimate, Observation, Touch
from palpate.grasp.monitors import (
    BoardMonitor,
    CeilingMonitor,
    FingersMonitor,
    ResponseMonitor,
    RestMonitor,
    SlipMonitor,
    TimeMonitor,
)
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
    estimate = ContactEstimate(now_s=1.1, still_since_s=0.0, touches=touches, strongest_n=1.0)
    return GraspState(phase=phase, estimate=estimate)


def resting(pressed: Touch, *, frames: int, still_s: float, phase: Phase) -> GraspState:
    """Return a grasp with as many equal frames since the hand came to rest."""
    estimate = ContactEstimate(now_s=still_s, still_since_s=0.0, touches=(pressed,) * frames)
    return GraspState(phase=phase, estimate=estimate)


@pytest.mark.parametrize(
    ("phase", "frames", "still_s", "reading", "is_alarm"),
    [
        (Phase.SQUEEZE, 6, 0.3, 6.9, True),
        (Phase.SETTLE, 6, 0.3, 6.9, True),
        (Phase.HOLD, 6, 0.3, 6.9, True),
        (Phase.HOLD, 6, 0.3, 7.0, False),
        (Phase.HOLD, 5, 0.3, 6.9, False),
        (Phase.HOLD, 6, 0.29, 6.9, False),
        (Phase.RELEASE, 6, 0.3, 0.0, False),
    ],
)
def test_slip_monitor_reading_below_fraction_raises_an_alarm_unless_opening(
    plan: Plan, phase: Phase, frames: int, still_s: float, reading: float, is_alarm: bool
) -> None:
    """Six frames, 0.3 s at rest, and 35 % of the largest reading, 20."""
    state = resting(touch(reading, time_s=0.2), frames=frames, still_s=still_s, phase=phase)
    state.estimate.strongest_n = 20.0
    alarm = SlipMonitor(plan).check(SEEN, state)
    assert (alarm and alarm.danger) is (Danger.SLIPPED if is_alarm else None)


@pytest.mark.parametrize(
    ("readings", "contact", "is_alarm"),
    [
        ((1.0, 2.0, 1.9, 1.8, 1.7), {}, True),
        ((2.0, 1.9, 1.8, 1.7), {}, True),
        ((1.0, 2.0, 1.9, 1.8), {}, False),
        ((1.0, 2.0, 1.9, 1.8, 1.85), {}, False),
        ((2.0, 1.9, 1.91, 1.8, 1.7), {}, False),
        ((2.0, 1.999, 1.998, 1.997), {}, False),
        ((2.0, 1.9, 1.8, 1.7, 2.1), {}, False),
        # Falls of exactly the limit, 1 % of the largest reading.
        ((100.0, 99.0, 98.0, 97.0), {}, False),
        ((2.0, 1.9, 1.8, 1.7), {"percent": READING.contact_percent}, True),
        ((2.0, 1.9, 1.8, 1.7), {"contact_s": None}, False),
        ((2.0, 1.9, 1.8, 1.7), {"contact_s": 1.0}, False),
        ((2.0, 1.9, 1.8, 1.7), {"is_lost": True}, False),
    ],
)
def test_response_monitor_three_falling_responses_in_contact_raise_an_alarm(
    plan: Plan, readings: tuple[float, ...], contact: dict[str, Any], is_alarm: bool
) -> None:
    """The contact is at its threshold, not yet there, later, or lost again."""
    steps = closing_steps(readings, step_mm=1.0, percent=contact.get("percent", -20.0))
    if "is_lost" in contact:
        steps += (ClosingStep(closure=24.0, touch=touch(0.0, percent=0.0, time_s=4.0)),)
    estimate = ContactEstimate(
        now_s=9.0, still_since_s=8.9, steps=steps, contact_s=contact.get("contact_s", 0.0)
    )
    state = GraspState(phase=Phase.SQUEEZE, estimate=estimate)
    alarm = ResponseMonitor(plan).check(SEEN, state)
    assert (alarm and alarm.danger) is (Danger.UNSEEN_FORCE if is_alarm else None)
    assert alarm is None or "the reading falls while the hand closes" in alarm.message


@pytest.mark.parametrize(
    ("phase", "frames", "still_s", "percents", "is_alarm"),
    [
        (Phase.SQUEEZE, 12, 9.0, (0.0, -40.0), True),
        (Phase.HOLD, 12, 9.0, (0.0, -40.0), True),
        (Phase.HOLD, 12, 9.0, (-30.0, -40.0), False),
        # A hint of contact at the other finger, exactly at its threshold.
        (Phase.HOLD, 12, 9.0, (-3.0, -40.0), False),
        (Phase.APPROACH, 12, 9.0, (0.0, -40.0), False),
        (Phase.RELEASE, 12, 9.0, (0.0, -40.0), False),
        # Three frames, 0.4 s at rest, and -6 % at one finger.
        (Phase.HOLD, 3, 0.4, (0.0, -6.0), True),
        (Phase.HOLD, 2, 0.4, (0.0, -6.0), False),
        (Phase.HOLD, 3, 0.29, (0.0, -6.0), False),
        (Phase.HOLD, 3, 0.4, (0.0, -5.9), False),
    ],
)
def test_fingers_monitor_grip_of_one_finger_alone_raises_an_alarm_while_holding(
    plan: Plan,
    phase: Phase,
    frames: int,
    still_s: float,
    percents: tuple[float, float],
    is_alarm: bool,
) -> None:
    pressed = replace(touch(1.0, time_s=0.2), finger_percent=percents)
    state = resting(pressed, frames=frames, still_s=still_s, phase=phase)
    alarm = FingersMonitor(plan).check(SEEN, state)
    assert (alarm and alarm.danger) is (Danger.SENSOR_LOST if is_alarm else None)
    message = "finger 1 measures a grip force and the other finger none"
    assert alarm is None or message in alarm.message


@pytest.mark.parametrize(
    ("activity", "opened_mm", "reading", "still_s", "is_alarm"),
    [
        (Activity.EASE, 1.0, 2.5, 5.0, True),
        (Activity.EASE, 1.0, 1.5, 5.0, False),
        (Activity.EASE, 0.0, 2.5, 5.0, False),
        (Activity.EASE, 1.0, 2.5, 0.0, False),
        (Activity.FORECAST, 1.0, 2.5, 5.0, False),
        # The shortest wait, and a rise of exactly the limit.
        (Activity.EASE, 1.0, 2.5, 0.1, True),
        (Activity.EASE, 1.0, 2.02, 5.0, False),
    ],
)
def test_response_monitor_rise_after_opening_raises_an_alarm(
    plan: Plan, activity: Activity, opened_mm: float, reading: float, still_s: float, is_alarm: bool
) -> None:
    steps = closing_steps((1.0, 2.0), step_mm=1.0)
    estimate = ContactEstimate(
        now_s=still_s,
        still_since_s=0.0,
        steps=steps,
        contact_s=0.0,
        closure=steps[-1].closure - opened_mm,
        touches=tuple(touch(reading, time_s=8.0 + 0.1 * number) for number in range(10)),
    )
    state = GraspState(
        phase=Phase.SETTLE, estimate=estimate, correction=Correction(activity=activity)
    )
    assert (ResponseMonitor(plan).check(SEEN, state) is not None) == is_alarm


def test_board_monitor_tripped_ceiling_raises_force_limit_alarm() -> None:
    assert BoardMonitor().check(SEEN, held(1.0)) is None
    tripped = replace(SEEN, frame=replace(SEEN.frame, ceiling_tripped=True))
    alarm = BoardMonitor().check(tripped, held(1.0))
    assert alarm.danger is Danger.FORCE_LIMIT
    assert "the board's own ceiling has tripped" in alarm.message


def test_rest_monitor_checks_each_new_rest_once(plan: Plan) -> None:
    monitor, state = RestMonitor(plan), held(1.0)
    found = list[bool]()
    for factor in (10.0, 10.0, None, 1.0, None, 10.0):
        state.estimate.rest_ohm = None if factor is None else factor * plan.rest_ohm
        alarm = monitor.check(SEEN, state)
        assert alarm is None or alarm.danger is Danger.SENSOR_LOST
        found.append(alarm is not None)
    assert found == [True, False, False, False, False, True]


@pytest.mark.parametrize(("excess", "is_alarm"), [(0.0, False), (0.01, True)])
def test_ceiling_and_time_monitor_raise_an_alarm_only_above_their_limits(
    plan: Plan, excess: float, is_alarm: bool
) -> None:
    state = held(1.0, phase=Phase.SETTLE)
    state.estimate.force_n = plan.safety.force_ceiling_n + excess
    state.estimate.began_s, state.estimate.now_s = 0.0, plan.longest_s + excess
    assert (CeilingMonitor(plan).check(SEEN, state) is not None) == is_alarm
    assert (TimeMonitor(plan).check(SEEN, state) is not None) == is_alarm
