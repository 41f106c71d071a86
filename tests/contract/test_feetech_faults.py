"""What is special about the Feetech driver: the leash, goals in one turn, and the stored phase."""

from __future__ import annotations

import pytest
from tests.contract.conftest import MakeServo
from tests.contract.hands import CLOSED_TICK, REPLY_S, Servo, make_world

from palpate.errors import DeviceError
from palpate.gripper import sts_series as sts
from palpate.gripper.feetech import open_gripper
from palpate.gripper.fingers import HingedJaw
from palpate.gripper.interface import GripperCommand


@pytest.fixture
def servo(feetech: Servo) -> Servo:
    feetech.open()
    return feetech


def test_feetech_closing_stops_within_the_leash_if_the_host_is_silent(servo: Servo) -> None:
    assert servo.move(10.0, rate=10.0).target == pytest.approx(10.0, abs=0.1)
    servo.wait(3.0)
    # At most 0.5 s at 10 mm/s (a wide jaw closes more slowly).
    assert 69.0 <= servo.width_mm <= 71.0
    assert not servo.is_moving
    servo.gripper.state()
    servo.wait(3.0)
    assert 64.0 <= servo.width_mm <= 67.0


def test_feetech_opening_completes_without_the_host(servo: Servo) -> None:
    servo.move(70.0)
    servo.wait(0.5)
    servo.gripper.release()
    servo.wait(3.0)
    assert servo.width_mm == pytest.approx(74.0, abs=0.1)


def test_feetech_stop_on_the_leash_cancels_the_remaining_travel(servo: Servo) -> None:
    servo.move(40.0, rate=10.0)
    servo.wait(3.0)
    servo.gripper.stop()
    stopped_mm = servo.width_mm
    for _ in range(10):
        servo.gripper.state()
        servo.wait(0.3)
    assert servo.width_mm == pytest.approx(stopped_mm, abs=0.05)
    assert not servo.gripper.state().moving


def test_feetech_stored_settings_that_do_no_harm_are_accepted(feetech: Servo) -> None:
    """No limits, both directions reversed, and an offset that the rig file knows."""
    feetech.bus.set(sts.MAX_POSITION_LIMIT, 0)
    feetech.bus.set(sts.PHASE, 12 + 1 + 128)
    feetech.bus.set(sts.HOMING_OFFSET, -85)
    feetech.bus.position_error = -85
    feetech.open(homing_offset=-85)
    feetech.move(60.0, rate=20.0)
    feetech.follow(2.0)
    assert feetech.width_mm == pytest.approx(60.0, abs=0.1)


@pytest.mark.parametrize(("ticks", "closed_tick"), [(50, CLOSED_TICK), (1500, CLOSED_TICK + 1500)])
def test_feetech_at_its_end_stop_is_accepted(feetech: Servo, ticks: int, closed_tick: int) -> None:
    feetech.bus.position_error = ticks
    gripper = feetech.open(closed_tick=closed_tick)
    assert gripper.state().width_mm == pytest.approx(76.0, abs=2.5)


@pytest.mark.parametrize(
    ("clips_to", "target_mm", "found"),
    [((1100, 4095), 8.0, 1100), ((0, 1500), 60.0, 1500), ((1300, 1400), 5.0, 1300)],
)
def test_feetech_that_shortens_its_goals_is_a_fault(
    servo: Servo, clips_to: tuple[int, int], target_mm: float, found: int
) -> None:
    servo.move(40.0)
    servo.bus.clips_to = clips_to
    servo.move(target_mm)
    with pytest.raises(DeviceError) as raised:
        servo.follow(3.0)
    assert f"Goal_Position (address 42) is {found}" in str(raised.value)
    assert "Min_Position_Limit (address 9), now 0" in str(raised.value)


def test_feetech_cycle_needs_two_exchanges(servo: Servo) -> None:
    servo.move(20.0, rate=10.0)
    before = servo.bus.packets
    for _ in range(15):
        servo.follow(1 / 15, every_s=1 / 15)
        servo.move(20.0, rate=10.0)
    assert servo.bus.packets - before == 30
    before = servo.bus.packets
    servo.follow(1.0, every_s=1 / 50)
    # A further goal is needed for each quarter of the leash of 0.5 s.
    assert servo.bus.packets - before <= 60
    assert servo.gripper.state().moving


def test_feetech_near_half_a_turn_keeps_to_the_servo_s_speed(make_servo: MakeServo) -> None:
    """The slope is 0 there, and the speed for a rate has no bound."""
    servo = make_servo(777, world=make_world("rigid"), jaw=HingedJaw(jaw_mm=37.0))
    servo.gripper = open_gripper(
        port=servo.bus.name, jaw_mm=37.0, closed_tick=CLOSED_TICK, highest_mm=74.0, reply_s=REPLY_S
    )
    servo.gripper.command(GripperCommand(target=74.0, rate=60.0))
    assert servo.bus.value(sts.GOAL_VELOCITY) == sts.MAX_VELOCITY
