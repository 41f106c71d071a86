"""Loss of a held object, and readings that do not follow the gripper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.factories import closing_steps, touch

from palpate.grasp.estimator import ContactEstimate, Observation, Touch
from palpate.grasp.monitors import (
    BoardMonitor,
    CeilingMonitor,
    FingersMonitor,
    RestMonitor,
    SlipMonitor,
    TimeMonitor,
)
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
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


@pytest.mark.parametrize(("return_closure", "is_alarm"), [(None, True), (21.0, False)])
def test_slip_monitor_compares_with_the_last_step_unless_the_hand_has_opened_again(
    plan: Plan, return_closure: float | None, is_alarm: bool
) -> None:
    state = resting(touch(6.9, time_s=0.2), frames=6, still_s=0.3, phase=Phase.SETTLE)
    state.estimate.strongest_n = 7.0
    state.estimate.steps = closing_steps([10.0, 20.0], step_mm=0.5)
    state.correction.return_closure = return_closure
    assert (SlipMonitor(plan).check(SEEN, state) is not None) == is_alarm


@pytest.mark.parametrize(
    ("phase", "percents", "frames", "free_percent", "is_alarm"),
    [
        (Phase.SQUEEZE, (0.0, -40.0), 3, 0.0, True),
        (Phase.HOLD, (0.0, -40.0), 3, 0.0, True),
        (Phase.HOLD, (0.0, -40.0), 2, 0.0, False),
        (Phase.HOLD, (-30.0, -40.0), 3, 0.0, False),
        # A hint of contact at the other finger, exactly at its threshold.
        (Phase.HOLD, (-3.0, -40.0), 3, 0.0, False),
        (Phase.APPROACH, (0.0, -40.0), 3, 0.0, False),
        # Two hints, -6 %.
        (Phase.HOLD, (0.0, -6.1), 3, 0.0, True),
        (Phase.HOLD, (0.0, -5.9), 3, 0.0, False),
        # The movement may hide as much load of the other finger as it hid in the approach.
        (Phase.HOLD, (0.0, -15.0), 3, 10.0, False),
        (Phase.HOLD, (0.0, -40.0), 3, 10.0, True),
    ],
)
def test_fingers_monitor_grip_of_one_finger_alone_raises_an_alarm(
    plan: Plan,
    phase: Phase,
    percents: tuple[float, float],
    frames: int,
    free_percent: float,
    is_alarm: bool,
) -> None:
    """The hand moves all the time, at the speed of the approach."""
    plan = replace(plan, squeeze_rate=plan.rate)
    monitor, found = FingersMonitor(plan), list[Alarm | None]()
    for percent in [(free_percent, free_percent)] * 4 + [percents] * frames:
        at = phase if percent == percents else Phase.APPROACH
        last = replace(touch(1.0), finger_percent=percent)
        state = GraspState(phase=at, estimate=ContactEstimate(last=last))
        found.append(monitor.check(SEEN, state))
    assert found[:-1] == [None] * (len(found) - 1)
    alarm = found[-1]
    assert (alarm and alarm.danger) is (Danger.SENSOR_LOST if is_alarm else None)
    message = "finger 1 measures a grip force and the other finger none"
    assert alarm is None or message in alarm.message


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
