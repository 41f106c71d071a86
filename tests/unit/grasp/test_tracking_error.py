"""A gripper that does not go where it was sent: late, beyond, idle, or an impossible report."""

from __future__ import annotations

import pytest

from palpate.grasp.safety import SafetyLimits
from palpate.grasp.tracking_error import Following, unbelievable
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState

WIDTH = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
PRESSURE = GripperLimits(drive="pressure", lowest=0.0, highest=50.0, fastest=40.0)
SAFETY = SafetyLimits()


def at(limits: GripperLimits, value: float, *, time_s: float = 0.0) -> GripperState:
    if limits.drive == "width":
        return GripperState(time_s=time_s, width_mm=value)
    return GripperState(time_s=time_s, pressure_kpa=value)


def sent(limits: GripperLimits, begin: float, target: float, rate: float = 20.0) -> Following:
    command = GripperCommand(target=target, rate=rate)
    return Following.of(command, state=at(limits, begin), now_s=1.0, limits=limits, safety=SAFETY)


@pytest.mark.parametrize(
    ("limits", "begin", "target"), [(WIDTH, 40.0, 30.0), (PRESSURE, 10.0, 20.0)]
)
def test_it_is_late_from_when_it_is_due(limits: GripperLimits, begin: float, target: float) -> None:
    way = sent(limits, begin, target)
    assert way.ends_s == pytest.approx(1.5)
    assert way.due_s == pytest.approx(1.5 + SAFETY.arrival_s)
    stands = at(limits, begin)
    before, due = way.due_s - 1e-6, way.due_s
    assert way.complaint(stands, now_s=before, limits=limits, safety=SAFETY) is None
    complaint = way.complaint(stands, now_s=due, limits=limits, safety=SAFETY)
    assert complaint is not None
    assert "is it blocked" in complaint
    there = at(limits, target)
    assert way.complaint(there, now_s=due, limits=limits, safety=SAFETY) is None


@pytest.mark.parametrize(
    ("limits", "begin", "target", "past", "allowed"),
    [
        (WIDTH, 40.0, 30.0, -1.0, SAFETY.past_mm),
        (PRESSURE, 10.0, 20.0, 1.0, SAFETY.past_kpa),
        # An opening hand may come from beyond its target.
        (WIDTH, 30.0, 40.0, -11.0, 10.0 + SAFETY.past_mm),
    ],
)
def test_running_on_is_known_at_once(
    limits: GripperLimits, begin: float, target: float, past: float, allowed: float
) -> None:
    way, direction = sent(limits, begin, target), past / abs(past)
    within = at(limits, target + direction * (allowed - 0.01))
    assert way.complaint(within, now_s=1.1, limits=limits, safety=SAFETY) is None
    beyond = at(limits, target + direction * (allowed + 0.01))
    complaint = way.complaint(beyond, now_s=1.1, limits=limits, safety=SAFETY)
    assert complaint is not None
    assert "runs on" in complaint


def test_only_a_hand_that_closes_by_width_is_looked_at_between_frames() -> None:
    often_s = SAFETY.past_mm / 20.0
    look = sent(WIDTH, 40.0, 30.0).glance_s
    assert look(now_s=1.2, limits=WIDTH, safety=SAFETY) == pytest.approx(often_s)
    assert look(now_s=1.5 + 1.9 * often_s, limits=WIDTH, safety=SAFETY) is not None
    assert look(now_s=1.5 + 2.1 * often_s, limits=WIDTH, safety=SAFETY) is None
    for way, limits in ((sent(WIDTH, 30.0, 40.0), WIDTH), (sent(PRESSURE, 10.0, 20.0), PRESSURE)):
        assert way.glance_s(now_s=1.2, limits=limits, safety=SAFETY) is None
    assert sent(WIDTH, 30.0, 30.0).glance_s(now_s=1.0, limits=WIDTH, safety=SAFETY) is None


@pytest.mark.parametrize(
    ("limits", "begin", "target"), [(WIDTH, 40.0, 30.0), (WIDTH, 30.0, 40.0), (PRESSURE, 10, 20)]
)
def test_idle_is_less_than_a_third_of_what_the_rate_makes(
    limits: GripperLimits, begin: float, target: float
) -> None:
    way, direction = sent(limits, begin, target), 1.0 if target > begin else -1.0

    def idle(made: float, now_s: float) -> bool | None:
        return way.idle(at(limits, begin + direction * made), now_s=now_s, limits=limits)

    # By 1.25 s the rate has made 5 mm or kPa.
    assert (idle(1.4, 1.25), idle(1.6, 1.25)) == (True, False)
    assert idle(0.0, 1.005) is None
    # Later than the way takes, no more than all of it is expected.
    assert (idle(2.9, 9.0), idle(3.1, 9.0)) == (True, False)


def test_reports_that_can_not_be() -> None:
    assert unbelievable(at(WIDTH, 5.0 - 4.9), limits=WIDTH) is None
    assert unbelievable(at(WIDTH, 74.0 + 5.1), limits=WIDTH) is not None
    assert unbelievable(at(PRESSURE, -9.9), limits=PRESSURE) is None
    words = unbelievable(at(PRESSURE, 60.1), limits=PRESSURE)
    assert words is not None
    assert "60.1 kPa" in words

    def drawing(current_ma: float) -> GripperState:
        return GripperState(time_s=0.0, width_mm=30.0, current_ma=current_ma)

    assert unbelievable(drawing(-19_999.0), limits=WIDTH) is None
    assert unbelievable(drawing(-20_000.0), limits=WIDTH) is not None
    assert unbelievable(drawing(float("nan")), limits=WIDTH) is None
    lost = unbelievable(drawing(float("nan")), limits=WIDTH, before=drawing(100.0))
    assert lost is not None
    assert "current of nan mA" in lost
