"""Contract of all grippers: simulated, on a servo line, and on a board."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from tests.contract.hands import HANDS, ON_FIRMWARE, Hand

from palpate.gripper.interface import GripperCommand

#: Tolerance of the reached target, mm or kPa.
TOLERANCE = {"width": 0.3, "pressure": 0.6}
#: A target in range, a target further closed, and a rate.
TARGETS = {"width": (60.0, 50.0, 10.0), "pressure": (10.0, 20.0, 8.0)}


@pytest.fixture(
    params=[
        pytest.param(name, marks=pytest.mark.system if name in ON_FIRMWARE else ())
        for name in HANDS
    ]
)
def hand(request: pytest.FixtureRequest) -> Iterator[Hand]:
    with HANDS[request.param]() as found:
        yield found


def read_drive_value(hand: Hand) -> float:
    return hand.gripper.limits.drive_reading(hand.gripper.state())


def move(hand: Hand, target: float, rate: float) -> GripperCommand:
    return hand.gripper.command(GripperCommand(target=target, rate=rate))


def test_gripper_limits_are_ordered_and_positive(hand: Hand) -> None:
    limits = hand.gripper.limits
    assert limits.lowest < limits.highest
    assert limits.fastest > 0


def test_gripper_reaches_the_commanded_target_and_reports_it(hand: Hand) -> None:
    drive = hand.gripper.limits.drive
    target, _, rate = TARGETS[drive]
    sent = move(hand, target, rate)
    assert sent.target == pytest.approx(target, abs=0.05)
    assert 0 < sent.rate <= rate * 1.001
    assert hand.gripper.state().moving
    hand.wait(4.0)
    assert not hand.gripper.state().moving
    assert read_drive_value(hand) == pytest.approx(sent.target, abs=TOLERANCE[drive])


def test_gripper_does_not_exceed_the_commanded_rate(hand: Hand) -> None:
    drive = hand.gripper.limits.drive
    target, _, rate = TARGETS[drive]
    before = read_drive_value(hand)
    sent = move(hand, target, rate / 4)
    hand.wait(1.0)
    # At constant servo speed the finger speed varies, up to the commanded rate.
    assert abs(read_drive_value(hand) - before) <= rate / 4 * 1.3 + TOLERANCE[drive]
    assert sent.rate <= rate / 4 * 1.001


@pytest.mark.parametrize("beyond", [-1e3, 1e3])
def test_gripper_command_is_clamped_and_returned_as_sent(hand: Hand, beyond: float) -> None:
    limits = hand.gripper.limits
    sent = move(hand, beyond, 1e6)
    end = limits.lowest if beyond < 0 else limits.highest
    assert sent.target == pytest.approx(end, abs=0.05)
    assert sent.rate <= limits.fastest * 1.001


def test_gripper_state_reports_only_its_controlled_quantity(hand: Hand) -> None:
    state = hand.gripper.state()
    drive = hand.gripper.limits.drive
    is_reported = [math.isfinite(state.width_mm), math.isfinite(state.pressure_kpa)]
    assert is_reported == [drive == "width", drive == "pressure"]
    assert state.time_s == hand.clock.now_s()


@pytest.mark.slow
def test_gripper_stop_does_not_close_further(hand: Hand) -> None:
    limits = hand.gripper.limits
    target, further, rate = TARGETS[limits.drive]
    move(hand, target, 4 * rate)
    hand.wait(4.0)
    move(hand, further, rate / 2)
    hand.wait(0.5)
    hand.gripper.stop()
    at_stop = limits.closure(hand.gripper.state())
    hand.wait(1.0)
    state = hand.gripper.state()
    assert limits.closure(state) <= at_stop + TOLERANCE[limits.drive]
    assert not state.moving


@pytest.mark.slow
def test_gripper_release_opens_fully(hand: Hand) -> None:
    target, _, rate = TARGETS[hand.gripper.limits.drive]
    move(hand, target, 4 * rate)
    hand.wait(4.0)
    hand.gripper.release()
    hand.wait(3.0)
    limits = hand.gripper.limits
    assert limits.closure(hand.gripper.state()) == pytest.approx(0.0, abs=TOLERANCE[limits.drive])


@pytest.mark.slow
def test_gripper_close_keeps_the_position_or_vents(hand: Hand) -> None:
    limits = hand.gripper.limits
    target, _, rate = TARGETS[limits.drive]
    move(hand, target, 4 * rate)
    hand.wait(4.0)
    before = hand.read_position()
    hand.gripper.close()
    first = [_wait_for_position(hand) for _ in range(2)][-1]
    hand.gripper.close()
    assert _wait_for_position(hand) == pytest.approx(first, abs=0.05), "second close has no effect"
    if limits.drive == "width":
        assert first == pytest.approx(before, abs=0.05), "a servo holds its position"
    else:
        assert first <= before + 0.05, "closing the device never raises the pressure"


def _wait_for_position(hand: Hand) -> float:
    for _ in range(20):
        hand.clock.sleep_s(0.1)
        now = hand.read_position()
    return now
