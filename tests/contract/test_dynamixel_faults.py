"""What is special about the DYNAMIXEL driver: watchdog, turns, reboot, and modes of the servo."""

from __future__ import annotations

import math
import signal
import subprocess
import sys

import pytest
from tests.contract.conftest import MakeServo
from tests.contract.hands import Servo, make_world

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.gripper import x_series as x
from palpate.gripper.fingers import CrankFingers
from palpate.gripper.interface import open_fully


@pytest.fixture
def servo(dynamixel: Servo) -> Servo:
    dynamixel.open()
    return dynamixel


def close_slowly(servo: Servo) -> None:
    servo.move(50.0, rate=5.0)


# -- stops -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_dynamixel_stop_without_a_reply_sets_the_shortest_watchdog(dynamixel: Servo) -> None:
    servo = dynamixel
    servo.open(reply_s=0.1)
    close_slowly(servo)
    servo.bus.late_s = math.inf
    with pytest.raises(DeviceTimeoutError):
        servo.gripper.stop()
    servo.bus.late_s = 0.0
    # A request with a reply ensures that the earlier packets were received.
    servo.gripper.state()
    assert servo.bus.value(x.BUS_WATCHDOG) == 1
    servo.wait(0.05)
    assert not servo.is_moving


def test_dynamixel_stop_raises_if_the_servo_still_moves(servo: Servo) -> None:
    close_slowly(servo)
    servo.bus.ignores_goals = True
    with pytest.raises(DeviceError, match="got a stop but still moves"):
        servo.gripper.stop()


def test_dynamixel_stop_at_rest_keeps_the_goal(servo: Servo) -> None:
    """A new goal would release the force of a loaded servo."""
    close_slowly(servo)
    servo.world.clock.sleep_s(6.0)
    servo.bus.position_error = 40
    before = servo.bus.value(x.GOAL_POSITION)
    servo.gripper.stop()
    assert servo.bus.value(x.GOAL_POSITION) == before


def test_dynamixel_watchdog_stops_the_servo_until_the_next_command(servo: Servo) -> None:
    close_slowly(servo)
    servo.wait(1.0)
    # 0.5 s plus one time step.
    assert servo.width_mm == pytest.approx(74.0 - 0.51 * 4.4, abs=0.4)
    assert not servo.gripper.state().moving
    servo.gripper.stop()
    close_slowly(servo)
    assert servo.gripper.state().moving
    assert servo.bus.value(x.BUS_WATCHDOG) == 25


def test_dynamixel_opening_stopped_by_the_watchdog_continues_with_the_next_command(
    servo: Servo,
) -> None:
    servo.move(50.0)
    servo.follow(1.0)
    servo.move(74.0, rate=10.0)
    servo.wait(6.0)
    state = servo.gripper.state()
    assert not state.moving
    assert state.width_mm < 60.0
    open_fully(servo.gripper, clock=servo.world.clock)
    assert servo.gripper.state().width_mm == pytest.approx(74.0, abs=0.1)


def test_dynamixel_stops_after_the_host_process_is_killed(dynamixel: Servo) -> None:
    program = (
        "import sys, time; from palpate.gripper.dynamixel import open_gripper;"
        "from palpate.gripper.interface import GripperCommand;"
        "g = open_gripper(port=sys.argv[1], reply_s=0.5);"
        "g.command(GripperCommand(target=40.0, rate=5.0));"
        "print('closing', flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", program, dynamixel.bus.name]
    host = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert host.stdout.readline() == b"closing\n"
    host.send_signal(signal.SIGKILL)
    assert host.wait() == -signal.SIGKILL
    host.stdout.close()
    moving = []
    for _ in range(60):
        dynamixel.world.clock.sleep_s(0.01)
        moving.append(dynamixel.is_moving)
    assert all(moving[:48])
    assert not any(moving[51:])


# -- movements -------------------------------------------------------------------------------------


def test_dynamixel_state_raises_for_an_unreachable_position(servo: Servo) -> None:
    assert servo.gripper.state().width_mm == pytest.approx(74.0, abs=0.05)
    servo.world.clock.sleep_s(1 / 15)
    servo.bus.position_error = -1500
    with pytest.raises(DeviceError, match="no servo turns that fast"):
        servo.gripper.state()


def test_dynamixel_slowest_movement_uses_velocity_1(servo: Servo) -> None:
    """The servo interprets velocity 0 as its maximum speed."""
    servo.move(50.0, rate=1e-3)
    assert servo.bus.value(x.PROFILE_VELOCITY) == 1


def test_dynamixel_that_shortens_its_goals_is_a_fault(servo: Servo) -> None:
    """As another program's goal: a servo of this family refuses goals beyond its limits."""
    close_slowly(servo)
    servo.world.clock.sleep_s(0.2)
    servo.gripper.state()
    servo.bus.set(x.GOAL_POSITION, 2700)
    servo.world.halt()
    with pytest.raises(DeviceError, match=r"Goal_Position \(address 116\) is 2700, but \d+ was"):
        servo.gripper.state()


def test_dynamixel_without_torque_while_opening_names_the_torque(servo: Servo) -> None:
    servo.move(50.0)
    servo.follow(1.0)
    servo.gripper.release()
    servo.bus.fail(x.HardwareError(0))
    with pytest.raises(DeviceError, match="without torque: its supply was interrupted"):
        servo.follow(3.0)


def test_dynamixel_moved_away_from_its_goal_is_a_fault(servo: Servo) -> None:
    servo.move(40.0)
    servo.follow(1.0)
    servo.move(35.0, rate=5.0)
    servo.world.clock.sleep_s(0.4)
    servo.gripper.state()
    servo.world.drive(74.0, rate=30.0)
    with pytest.raises(DeviceError, match=r"away from its goal .* check Drive_Mode"):
        servo.follow(1.0)


def test_dynamixel_that_coasts_before_it_turns_back_is_no_fault(servo: Servo) -> None:
    servo.move(50.0)
    servo.world.clock.sleep_s(0.1)
    servo.gripper.state()
    servo.gripper.release()
    servo.world.drive(50.0, rate=60.0)
    servo.follow(0.15)
    servo.world.drive(74.0, rate=60.0)
    state = servo.follow(1.0)
    assert not state.moving
    assert state.width_mm == pytest.approx(74.0, abs=0.1)


def test_dynamixel_cycle_needs_two_exchanges(servo: Servo) -> None:
    """An adapter can delay each reply by 16 ms."""
    servo.world.clock.sleep_s(0.1)
    before = servo.bus.packets
    servo.gripper.state()
    close_slowly(servo)
    assert servo.bus.packets - before == 2
    servo.world.clock.sleep_s(0.1)
    close_slowly(servo)
    assert servo.bus.packets - before == 4, "an old position must be read again"


@pytest.mark.parametrize("model", [1020, 1200])
def test_dynamixel_closing_current_is_positive(make_servo: MakeServo, model: int) -> None:
    """The register value is negative, because positions decrease as the fingers close."""
    world = make_world("rigid", "rigid-block")
    servo = make_servo(model, world=world)
    servo.open()
    servo.move(30.0, rate=20.0)
    while servo.force_n < 5.0:
        world.clock.sleep_s(0.02)
        state = servo.gripper.state()
    assert servo.bus.value(x.PRESENT_CURRENT) < 0
    # 14 mA per newton, and 40 mA for the gears.
    assert 60.0 < state.current_ma < 300.0


# -- errors ----------------------------------------------------------------------------------------


def test_dynamixel_overload_raises_until_clear_errors(dynamixel: Servo) -> None:
    """The servo counted other turns before its reboot."""
    servo, dynamixel.bus.position_error = dynamixel, 2 * x.TICKS
    servo.open()
    close_slowly(servo)
    servo.world.clock.sleep_s(0.2)
    servo.bus.fail(x.HardwareError.OVERLOAD | x.HardwareError.OVERHEATING)
    for method in (servo.gripper.state, lambda: close_slowly(servo)):
        with pytest.raises(DeviceError, match=r"overheating, overload; its torque is off"):
            method()
    servo.gripper.stop()
    before_s, width_mm = servo.world.clock.now_s(), servo.width_mm
    servo.gripper.clear_errors()
    assert servo.world.clock.now_s() > before_s, "the driver must wait for the restart"
    close_slowly(servo)
    state = servo.gripper.state()
    assert state.moving
    assert state.width_mm == pytest.approx(width_mm, abs=0.05)
    assert abs(servo.bus.value(x.GOAL_POSITION)) < x.TICKS


def test_dynamixel_opened_with_an_error_raises_it_and_needs_its_settings_later(
    dynamixel: Servo,
) -> None:
    """Its supply was switched off and on."""
    dynamixel.bus.fail(x.HardwareError.OVERLOAD)
    gripper = dynamixel.open()
    with pytest.raises(DeviceError, match="overload"):
        gripper.state()
    dynamixel.bus.set(x.HARDWARE_ERROR, 0)
    for method in (gripper.state, lambda: close_slowly(dynamixel)):
        with pytest.raises(DeviceError, match="Open the rig again"):
            method()


def test_dynamixel_voltage_error_with_shutdown_switches_the_torque_off(servo: Servo) -> None:
    servo.bus.set(x.SHUTDOWN, 0x35)
    servo.bus.fail(x.HardwareError.INPUT_VOLTAGE)
    with pytest.raises(DeviceError, match=r"input voltage; its torque is off\. Its supply"):
        servo.gripper.state()


# -- settings of an earlier host -------------------------------------------------------------------


def test_dynamixel_setup_replaces_mode_profile_and_level_of_an_earlier_host(
    dynamixel: Servo,
) -> None:
    """The torque was left on, which locks the mode; no command would be acknowledged."""
    bus = dynamixel.bus
    bus.set(x.OPERATING_MODE, x.Mode.POSITION)
    bus.set(x.DRIVE_MODE, x.TIME_BASED)
    bus.set(x.TORQUE_ENABLE, 1)
    dynamixel.open()
    assert bus.value(x.OPERATING_MODE) == x.Mode.CURRENT_BASED_POSITION
    assert (bus.value(x.DRIVE_MODE), bus.value(x.TORQUE_ENABLE)) == (0, 1)
    close_slowly(dynamixel)
    dynamixel.follow(1.0)
    assert dynamixel.width_mm == pytest.approx(69.5, abs=1.0)


@pytest.mark.parametrize("level", [0, 1])
def test_dynamixel_that_acknowledges_no_commands_is_corrected(dynamixel: Servo, level: int) -> None:
    dynamixel.bus.set(x.STATUS_RETURN_LEVEL, level)
    dynamixel.open()
    assert dynamixel.bus.value(x.STATUS_RETURN_LEVEL) == x.ALL_REPLIES


@pytest.mark.parametrize("model", [1020, 1060])
@pytest.mark.parametrize("turns", [-1, 5])
def test_dynamixel_counting_other_turns_moves_to_the_true_width(
    make_servo: MakeServo, model: int, turns: int
) -> None:
    servo = make_servo(model)
    servo.bus.set(x.OPERATING_MODE, 4)
    servo.bus.position_error = turns * x.TICKS
    assert servo.open().state().width_mm == pytest.approx(74.0, abs=0.05)
    servo.move(50.0, rate=20.0)
    assert abs(servo.bus.value(x.GOAL_POSITION) - servo.bus.value(x.PRESENT_POSITION)) < 800
    state = servo.follow(3.0)
    assert servo.width_mm == pytest.approx(50.0, abs=0.1)
    assert state.width_mm == pytest.approx(50.0, abs=0.1)


@pytest.mark.parametrize(("width_mm", "ticks"), [(76.0, 50), (20.0, -50)])
def test_dynamixel_at_its_end_stop_is_accepted(
    make_servo: MakeServo, width_mm: float, ticks: int
) -> None:
    fingers = CrankFingers(offset_mm=74.0 - width_mm)
    servo = make_servo(1020, world=make_world("rigid"), fingers=fingers)
    servo.bus.position_error = ticks
    assert servo.open().state().width_mm == pytest.approx(width_mm, abs=0.2)
    # The slope of the mechanism is 0 there, so that any speed of the servo is slow enough.
    sent = servo.move(width_mm)
    assert servo.bus.value(x.PROFILE_VELOCITY) <= servo.bus.value(x.VELOCITY_LIMIT)
    assert math.isfinite(sent.rate)


def test_dynamixel_expected_homing_offset_is_used(dynamixel: Servo) -> None:
    """A horn mounted 500 steps too far is corrected by the servo."""
    dynamixel.bus.position_error = 500
    dynamixel.bus.set(x.HOMING_OFFSET, -500)
    gripper = dynamixel.open(homing_offset=-500)
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.05)


def test_dynamixel_opened_again_keeps_its_grip(servo: Servo) -> None:
    close_slowly(servo)
    goal = servo.bus.value(x.GOAL_POSITION)
    servo.gripper.close()
    servo.open()
    assert servo.bus.value(x.GOAL_POSITION) == goal
