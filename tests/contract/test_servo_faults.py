"""The DYNAMIXEL driver with all failures of a servo, alone and during a grasp."""

from __future__ import annotations

import errno
import math
import os
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.conftest import calibrate_once
from tests.contract.faulty import run_recorded_grasp
from tests.contract.hands import (
    BAUD,
    REPLY_S,
    make_world,
    open_servo,
    pass_time,
    read_for,
)
from tests.contract.servo_bus import ServoBus

from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, InputError
from palpate.grasp.estimator import Observation
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import use_paper_method
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper import x_series as x
from palpate.gripper.dynamixel import DynamixelGripper, open_gripper
from palpate.gripper.fingers import CrankFingers
from palpate.gripper.interface import GripperCommand, open_fully
from palpate.gripper.packets import Register
from palpate.gripper.servo_line import RefusedError, ServoLine
from palpate.recording import load_recording
from palpate.rig import open_rig
from palpate.sensor.byte_stream import SerialStream
from palpate.twin.devices import TwinArray
from palpate.twin.world import World


@pytest.fixture
def world() -> World:
    return make_world("rigid", "strawberry")


@pytest.fixture
def bus(world: World) -> Iterator[ServoBus]:
    bus = ServoBus(world)
    yield bus
    bus.close()


@pytest.fixture
def gripper(world: World, bus: ServoBus) -> Iterator[DynamixelGripper]:
    gripper = open_servo(world, bus)
    yield gripper
    gripper.close()


def close_slowly(gripper: DynamixelGripper) -> None:
    gripper.command(GripperCommand(target=50.0, rate=5.0))


@pytest.mark.slow
def test_dynamixel_without_a_reply_raises_a_timeout(
    gripper: DynamixelGripper, bus: ServoBus
) -> None:
    bus.silent = True
    for method in (gripper.state, gripper.stop):
        with pytest.raises(DeviceTimeoutError, match=r"servo 9 on /dev/pts/\d+ does not reply"):
            method()


def test_dynamixel_retries_damaged_replies(gripper: DynamixelGripper, bus: ServoBus) -> None:
    bus.damaged_replies = 2
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.05)
    bus.damaged_replies = 3
    with pytest.raises(DeviceError, match="replies are damaged") as raised:
        gripper.state()
    assert not isinstance(raised.value, DeviceTimeoutError)


@pytest.mark.parametrize("cut_at", [1, 8, 12])
def test_servo_line_truncated_reply_raises_a_timeout(bus: ServoBus, cut_at: int) -> None:
    line = ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=0.2)
    bus.cut_at = cut_at
    with pytest.raises(DeviceTimeoutError, match=r"late or incomplete .* reply_s in the rig file"):
        line.read(x.MODEL_NUMBER)
    bus.cut_at = None
    line.close()


@pytest.mark.slow
@pytest.mark.parametrize("late_s", [0.09, 0.2])
def test_servo_line_does_not_use_a_late_reply_for_the_next_request(
    world: World, bus: ServoBus, late_s: float
) -> None:
    """With a reply limit of 50 ms, an answer is correct or missing."""
    line = ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=0.05)
    gripper = DynamixelGripper(line, clock=world.clock, fingers=CrankFingers())
    close_slowly(gripper)
    world.clock.sleep_s(1.0)
    position_mm = world.drive_value(world.clock.now_s())
    for late_now_s in (late_s, 0.0):
        bus.late_s, answered, silent = late_now_s, 0, 0
        requests = 10 * [(x.CURRENT_LIMIT, 1193), (x.MODEL_NUMBER, 1020), (x.GOAL_PWM, 885)]
        for register, value in requests[: 6 if late_now_s else None]:
            try:
                assert line.read(register) == value
                assert gripper.state().width_mm == pytest.approx(position_mm, abs=0.1)
                answered += 1
            except DeviceTimeoutError:
                silent += 1
        assert silent if late_now_s else answered
    gripper.close()


@pytest.mark.slow
def test_dynamixel_stop_without_a_reply_sets_the_shortest_watchdog(
    gripper: DynamixelGripper, bus: ServoBus, world: World
) -> None:
    close_slowly(gripper)
    bus.late_s = math.inf
    with pytest.raises(DeviceTimeoutError):
        gripper.stop()
    bus.late_s = 0.0
    # A request with a reply ensures that the earlier packets were received.
    gripper.state()
    assert bus.value(x.BUS_WATCHDOG) == 1
    pass_time(world, 0.05)
    assert not world.is_moving(world.clock.now_s())


def test_dynamixel_stop_raises_if_the_servo_still_moves(
    gripper: DynamixelGripper, bus: ServoBus
) -> None:
    close_slowly(gripper)
    bus.ignores_goals = True
    with pytest.raises(DeviceError, match="got a stop but still moves"):
        gripper.stop()


def test_dynamixel_stop_at_rest_keeps_the_goal(
    gripper: DynamixelGripper, bus: ServoBus, world: World
) -> None:
    """A new goal would release the force of a loaded servo."""
    close_slowly(gripper)
    world.clock.sleep_s(6.0)
    bus.position_error = 40
    before = bus.value(x.GOAL_POSITION)
    gripper.stop()
    assert bus.value(x.GOAL_POSITION) == before


def test_dynamixel_state_raises_for_an_unreachable_position(
    gripper: DynamixelGripper, bus: ServoBus, world: World
) -> None:
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.05)
    world.clock.sleep_s(1 / 15)
    bus.position_error = -1500
    with pytest.raises(DeviceError, match="no servo turns that fast"):
        gripper.state()


@pytest.mark.parametrize(
    ("model_number", "options", "words"),
    [
        (1020, {"current_limit_ma": 0.0}, "current_limit_ma 0: must be above 0 and at most 3209"),
        (1020, {"current_limit_ma": 5000.0}, "at most 3209"),
        (1060, {"pwm_limit_percent": 101.0}, "101: must be above 0 and at most 100"),
        (1020, {"watchdog_s": 0.0}, "watchdog_s 0: the servo's watchdog requires 0.02 to 2.54 s"),
        (1020, {"watchdog_s": math.nan}, "watchdog_s nan"),
    ],
)
def test_dynamixel_limits_out_of_range_are_refused(
    world: World, model_number: int, options: dict[str, float], words: str
) -> None:
    bus = ServoBus(world, model_number=model_number)
    with pytest.raises(InputError, match=words):
        open_servo(world, bus, **options)
    bus.close()


def test_dynamixel_slowest_movement_uses_velocity_1(
    gripper: DynamixelGripper, bus: ServoBus
) -> None:
    """The servo interprets velocity 0 as its maximum speed."""
    gripper.command(GripperCommand(target=50.0, rate=1e-3))
    assert bus.value(x.PROFILE_VELOCITY) == 1


def test_dynamixel_command_rearms_a_tripped_watchdog(
    gripper: DynamixelGripper, bus: ServoBus, world: World
) -> None:
    close_slowly(gripper)
    pass_time(world, 0.6)
    assert not gripper.state().moving
    close_slowly(gripper)
    assert bus.value(x.BUS_WATCHDOG) == 25


def test_dynamixel_overload_raises_until_clear_errors(
    gripper: DynamixelGripper, bus: ServoBus, world: World
) -> None:
    close_slowly(gripper)
    world.clock.sleep_s(0.2)
    bus.fail(x.HardwareError.OVERLOAD | x.HardwareError.OVERHEATING)
    for method in (gripper.state, lambda: close_slowly(gripper)):
        with pytest.raises(DeviceError, match=r"overheating, overload; its torque is off"):
            method()
    gripper.stop()
    before_s = world.clock.now_s()
    gripper.clear_errors()
    assert world.clock.now_s() > before_s, "the driver must wait for the restart"
    close_slowly(gripper)
    assert gripper.state().moving


def test_dynamixel_can_be_opened_with_a_hardware_error(world: World, bus: ServoBus) -> None:
    bus.fail(x.HardwareError.OVERLOAD)
    gripper = open_servo(world, bus)
    with pytest.raises(DeviceError, match="overload"):
        gripper.state()
    gripper.close()


def test_servo_line_write_to_locked_memory_is_refused(bus: ServoBus) -> None:
    line = ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=REPLY_S)
    line.write(x.TORQUE_ENABLE, 1)
    with pytest.raises(RefusedError, match="refused: access") as refused:
        line.write(x.OPERATING_MODE, x.Mode.POSITION)
    assert refused.value.code == x.PacketError.ACCESS
    line.close()


@pytest.mark.parametrize(
    ("model_number", "mode", "register", "value"),
    [
        (1020, x.Mode.CURRENT_BASED_POSITION, x.GOAL_CURRENT, round(300 / 2.69)),
        (1200, x.Mode.CURRENT_BASED_POSITION, x.GOAL_CURRENT, 300),
        (1060, x.Mode.POSITION, x.GOAL_PWM, round(0.4 * 885)),
    ],
)
def test_dynamixel_setup_writes_limits_and_watchdog(
    world: World, model_number: int, mode: x.Mode, register: x.Register, value: int
) -> None:
    bus = ServoBus(world, model_number=model_number)
    bus.set(x.PROFILE_ACCELERATION, 30)
    gripper = open_servo(world, bus, current_limit_ma=300.0, pwm_limit_percent=40.0, watchdog_s=0.2)
    wanted = {x.OPERATING_MODE: mode, register: value, x.TORQUE_ENABLE: 1, x.BUS_WATCHDOG: 10}
    wanted[x.PROFILE_ACCELERATION] = 0
    assert {written: bus.value(written) for written in wanted} == wanted
    assert math.isnan(gripper.state().current_ma) == (model_number == 1060)
    gripper.close()
    bus.close()


@pytest.mark.parametrize("model_number", [1020, 1200])
def test_dynamixel_closing_current_is_positive(model_number: int) -> None:
    """The register value is negative, because positions decrease as the fingers close."""
    world = make_world("rigid", "rigid-block")
    bus = ServoBus(world, model_number=model_number)
    gripper = open_servo(world, bus)
    gripper.command(GripperCommand(target=30.0, rate=20.0))
    while world.force_n(world.clock.now_s()) < 5.0:
        world.clock.sleep_s(0.02)
        state = gripper.state()
    assert bus.value(x.PRESENT_CURRENT) < 0
    # 14 mA per newton, and 40 mA for the gears.
    assert 60.0 < state.current_ma < 300.0
    gripper.close()
    bus.close()


def test_dynamixel_setup_switches_torque_off_to_change_the_mode(
    world: World, bus: ServoBus
) -> None:
    """An earlier host has left the torque on in another mode, which locks the mode."""
    bus.set(x.OPERATING_MODE, x.Mode.POSITION)
    bus.set(x.TORQUE_ENABLE, 1)
    gripper = open_servo(world, bus)
    assert bus.value(x.OPERATING_MODE) == x.Mode.CURRENT_BASED_POSITION
    assert bus.value(x.TORQUE_ENABLE) == 1
    gripper.close()


def test_dynamixel_setup_replaces_a_time_based_profile(world: World, bus: ServoBus) -> None:
    bus.set(x.DRIVE_MODE, x.TIME_BASED)
    gripper = open_servo(world, bus)
    assert bus.value(x.DRIVE_MODE) == 0
    close_slowly(gripper)
    for _ in range(10):
        world.clock.sleep_s(0.1)
        gripper.state()
    assert world.drive_value(world.clock.now_s()) == pytest.approx(69.5, abs=1.0)
    gripper.close()


def test_dynamixel_in_reverse_mode_is_refused(world: World, bus: ServoBus) -> None:
    bus.set(x.DRIVE_MODE, x.REVERSE | x.TIME_BASED)
    with pytest.raises(DeviceError, match=r"runs in reverse \(DRIVE_MODE 5\).*Wizard"):
        open_servo(world, bus)
    assert bus.value(x.TORQUE_ENABLE) == 0


@pytest.mark.parametrize("model_number", [1020, 1060])
@pytest.mark.parametrize("turns", [-1, 5])
def test_dynamixel_counting_other_turns_moves_to_the_true_width(
    world: World, model_number: int, turns: int
) -> None:
    bus = ServoBus(world, model_number=model_number)
    bus.set(x.OPERATING_MODE, 4)
    bus.position_error = turns * x.TICKS
    gripper = open_servo(world, bus)
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.05)
    gripper.command(GripperCommand(target=50.0, rate=20.0))
    assert abs(bus.value(x.GOAL_POSITION) - bus.value(x.PRESENT_POSITION)) < 800
    for _ in range(30):
        world.clock.sleep_s(0.1)
        state = gripper.state()
    assert world.drive_value(world.clock.now_s()) == pytest.approx(50.0, abs=0.1)
    assert state.width_mm == pytest.approx(50.0, abs=0.1)
    gripper.close()
    bus.close()


def test_dynamixel_finds_its_turn_again_after_a_reboot(world: World, bus: ServoBus) -> None:
    bus.position_error = 2 * x.TICKS
    gripper = open_servo(world, bus)
    bus.fail(x.HardwareError.OVERLOAD)
    gripper.clear_errors()
    gripper.command(GripperCommand(target=60.0, rate=20.0))
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.05)
    assert abs(bus.value(x.GOAL_POSITION)) < x.TICKS
    gripper.close()


@pytest.mark.parametrize("ticks", [300, 2048, -2000, 4096 + 700])
def test_dynamixel_outside_its_travel_is_refused(world: World, bus: ServoBus, ticks: int) -> None:
    bus.position_error = ticks
    with pytest.raises(DeviceError, match=r"Present_Position \(address 132\) is .* horn") as raised:
        open_servo(world, bus)
    assert "\n" not in str(raised.value)
    assert bus.value(x.TORQUE_ENABLE) == 0


@pytest.mark.parametrize(("width_mm", "ticks"), [(76.0, 50), (20.0, -50)])
def test_dynamixel_at_its_end_stop_is_accepted(width_mm: float, ticks: int) -> None:
    world = make_world("rigid")
    bus = ServoBus(world, fingers=CrankFingers(offset_mm=74.0 - width_mm))
    bus.position_error = ticks
    gripper = open_servo(world, bus)
    assert gripper.state().width_mm == pytest.approx(width_mm, abs=0.2)
    # The slope of the mechanism is 0 there, so that any speed of the servo is slow enough.
    sent = gripper.command(GripperCommand(target=width_mm, rate=60.0))
    assert bus.value(x.PROFILE_VELOCITY) <= bus.value(x.VELOCITY_LIMIT)
    assert math.isfinite(sent.rate)
    gripper.close()
    bus.close()


@pytest.mark.parametrize(
    ("register", "value", "remedy"),
    [
        (x.MIN_POSITION_LIMIT, 2100, "Set it to 1802 or less with DYNAMIXEL Wizard"),
        (x.MAX_POSITION_LIMIT, 2600, "Set it to 2875 or more with DYNAMIXEL Wizard"),
        (x.HOMING_OFFSET, -300, "add homing_offset = -300 to"),
        (x.HOMING_OFFSET, 4096, "Set the register to 0 with DYNAMIXEL Wizard"),
        (x.VELOCITY_LIMIT, 40, "60 mm/s need"),
        (x.DRIVE_MODE, x.REVERSE, "Clear bit 0 of Drive_Mode"),
    ],
)
@pytest.mark.parametrize("model_number", [1020, 1060])
def test_dynamixel_stored_setting_that_misleads_the_fingers_is_refused(
    world: World, model_number: int, register: Register, value: int, remedy: str
) -> None:
    bus = ServoBus(world, model_number=model_number)
    bus.set(register, value)
    with pytest.raises(DeviceError) as raised:
        open_servo(world, bus)
    message = str(raised.value)
    assert f"{register.name} (address {register.address})" in message
    assert str(value) in message
    assert remedy in message
    assert bus.value(x.TORQUE_ENABLE) == 0
    bus.close()


@pytest.mark.parametrize("model_number", [1020, 1060])
@pytest.mark.parametrize("ticks", [-70, -300, -1024, -1800])
def test_dynamixel_at_its_end_stop_before_its_goal_names_the_horn(
    world: World, model_number: int, ticks: int
) -> None:
    """With open fingers, this shift leaves the position within the travel."""
    bus = ServoBus(world, model_number=model_number)
    bus.position_error = ticks
    gripper = open_servo(world, bus)
    with pytest.raises(DeviceError, match=rf"at least {-ticks} steps wrong") as raised:
        open_fully(gripper, clock=world.clock)
    assert "The horn is mounted at a wrong angle" in str(raised.value)
    assert "set Homing_Offset (address 20) with DYNAMIXEL Wizard" in str(raised.value)
    gripper.close()
    bus.close()


def test_dynamixel_that_shortens_its_goals_is_a_fault(
    world: World, bus: ServoBus, gripper: DynamixelGripper
) -> None:
    """As another program's goal: a servo of this family refuses goals beyond its limits."""
    close_slowly(gripper)
    world.clock.sleep_s(0.2)
    gripper.state()
    bus.set(x.GOAL_POSITION, 2700)
    world.halt()
    with pytest.raises(DeviceError, match=r"Goal_Position \(address 116\) is 2700, but \d+ was"):
        gripper.state()


def test_dynamixel_without_torque_while_opening_names_the_torque(
    world: World, bus: ServoBus, gripper: DynamixelGripper
) -> None:
    gripper.command(GripperCommand(target=50.0, rate=60.0))
    read_for(world, gripper, 1)
    gripper.release()
    bus.fail(x.HardwareError(0))
    with pytest.raises(DeviceError, match="without torque: its supply was interrupted"):
        read_for(world, gripper, 3)


def test_dynamixel_moved_away_from_its_goal_is_a_fault(
    world: World, gripper: DynamixelGripper
) -> None:
    gripper.command(GripperCommand(target=40.0, rate=60.0))
    read_for(world, gripper, 1)
    gripper.command(GripperCommand(target=35.0, rate=5.0))
    world.clock.sleep_s(0.4)
    gripper.state()
    world.drive(74.0, rate=30.0)
    with pytest.raises(DeviceError, match=r"away from its goal .* check Drive_Mode"):
        read_for(world, gripper, 1)


def test_dynamixel_that_coasts_before_it_turns_back_is_no_fault(
    world: World, gripper: DynamixelGripper
) -> None:
    gripper.command(GripperCommand(target=50.0, rate=60.0))
    world.clock.sleep_s(0.1)
    gripper.state()
    gripper.release()
    world.drive(50.0, rate=60.0)
    read_for(world, gripper, 0.15)
    world.drive(74.0, rate=60.0)
    state = read_for(world, gripper, 1.0)
    assert not state.moving
    assert state.width_mm == pytest.approx(74.0, abs=0.1)


def test_dynamixel_opening_stopped_by_the_watchdog_continues_with_the_next_command(
    world: World, gripper: DynamixelGripper
) -> None:
    gripper.command(GripperCommand(target=50.0, rate=60.0))
    read_for(world, gripper, 1)
    gripper.command(GripperCommand(target=74.0, rate=10.0))
    pass_time(world, 6.0)
    state = gripper.state()
    assert not state.moving
    assert state.width_mm < 60.0
    open_fully(gripper, clock=world.clock)
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.1)


def test_dynamixel_expected_homing_offset_is_used(world: World, bus: ServoBus) -> None:
    """A horn mounted 500 steps too far is corrected by the servo."""
    bus.position_error = 500
    bus.set(x.HOMING_OFFSET, -500)
    gripper = open_servo(world, bus, homing_offset=-500)
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.05)
    gripper.close()


@pytest.mark.parametrize("level", [0, 1])
def test_dynamixel_that_acknowledges_no_commands_is_corrected(
    world: World, bus: ServoBus, level: int
) -> None:
    bus.set(x.STATUS_RETURN_LEVEL, level)
    gripper = open_servo(world, bus)
    assert bus.value(x.STATUS_RETURN_LEVEL) == x.ALL_REPLIES
    gripper.close()


@pytest.mark.parametrize("model_number", [1020, 1060])
def test_dynamixel_setup_does_not_move_to_an_old_goal(world: World, model_number: int) -> None:
    """Not even from an end stop beyond the range of the rig file."""
    bus = ServoBus(world, model_number=model_number)
    bus.position_error = 100
    bus.set(x.GOAL_POSITION, x.CENTRE_TICK)
    gripper = open_servo(world, bus)
    assert bus.value(x.GOAL_POSITION) == bus.value(x.PRESENT_POSITION)
    gripper.close()
    bus.close()


def test_dynamixel_opened_again_keeps_its_grip(world: World, bus: ServoBus) -> None:
    gripper = open_servo(world, bus)
    close_slowly(gripper)
    goal = bus.value(x.GOAL_POSITION)
    gripper.close()
    gripper = open_servo(world, bus)
    assert bus.value(x.GOAL_POSITION) == goal
    gripper.close()


@pytest.mark.parametrize(
    ("error", "torque", "cause"),
    [
        (x.HardwareError.INPUT_VOLTAGE, "on", "supply is at 8.9 V now (9.5 to 16.0 V are allowed)"),
        (x.HardwareError.OVERHEATING, "off", "servo is at 84 °C"),
        (x.HardwareError.OVERLOAD, "off", "load was too large"),
        (x.HardwareError.ELECTRICAL_SHOCK, "off", "short circuit"),
        (x.HardwareError.ENCODER, "on", "position sensor"),
        (x.HardwareError(0x40), "on", "error 0x40"),
    ],
)
def test_dynamixel_error_names_its_cause_and_the_torque(
    gripper: DynamixelGripper,
    bus: ServoBus,
    error: x.HardwareError,
    torque: str,
    cause: str,
) -> None:
    bus.set(x.PRESENT_VOLTAGE, 89)
    bus.set(x.PRESENT_TEMPERATURE, 84)
    bus.fail(error)
    for method in (gripper.state, lambda: close_slowly(gripper)):
        with pytest.raises(DeviceError, match=f"its torque is {torque}") as raised:
            method()
        assert cause in str(raised.value)
    message = str(raised.value)
    assert ("V now" in message) == (error is x.HardwareError.INPUT_VOLTAGE)
    assert ("°C" in message) == (error is x.HardwareError.OVERHEATING)


def test_dynamixel_voltage_error_with_shutdown_switches_the_torque_off(
    gripper: DynamixelGripper, bus: ServoBus
) -> None:
    bus.set(x.SHUTDOWN, 0x35)
    bus.fail(x.HardwareError.INPUT_VOLTAGE)
    with pytest.raises(DeviceError, match=r"input voltage; its torque is off\. Its supply"):
        gripper.state()


def test_dynamixel_restarted_without_its_settings_is_refused(world: World, bus: ServoBus) -> None:
    """It was opened with an error, and its supply was switched off and on."""
    bus.fail(x.HardwareError.OVERLOAD)
    gripper = open_servo(world, bus)
    bus.set(x.HARDWARE_ERROR, 0)
    for method in (gripper.state, lambda: close_slowly(gripper)):
        with pytest.raises(DeviceError, match="Open the rig again"):
            method()
    gripper.close()


def test_servo_cycle_needs_two_exchanges(world: World, bus: ServoBus) -> None:
    """An adapter can delay each reply by 16 ms."""
    gripper = open_servo(world, bus)
    world.clock.sleep_s(0.1)
    before = bus.packets
    gripper.state()
    close_slowly(gripper)
    assert bus.packets - before == 2
    world.clock.sleep_s(0.1)
    close_slowly(gripper)
    assert bus.packets - before == 4, "an old position must be read again"
    gripper.close()


def test_servo_line_reply_16_ms_late_needs_no_second_try(bus: ServoBus) -> None:
    line = ServoLine(bus.name, servo_id=9, baud=BAUD)
    bus.late_s = 0.016
    for _ in range(10):
        line.read(x.MODEL_NUMBER)
    assert bus.packets == 10
    line.close()


@pytest.mark.parametrize("pause_s", [0.06, 0.2])
def test_servo_line_uses_a_reply_that_arrived_while_the_process_did_not_run(
    bus: ServoBus, pause_s: float
) -> None:
    line = ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=0.05)
    bus.late_s, port = 0.02, line._port
    read, pauses = port.readPort, [pause_s]

    def read_slowly(size: int) -> bytes:
        data = bytes(read(size))
        if not data and pauses:
            time.sleep(pauses.pop())
        return data

    port.readPort = read_slowly
    assert line.read(x.MODEL_NUMBER) == 1020
    assert not pauses
    assert bus.packets == 1
    line.close()


def test_servo_line_on_the_port_of_a_device_that_never_pauses_times_out() -> None:
    """The SDK itself reads such a port for ever."""
    device, port = os.openpty()
    tty.setraw(port)
    os.set_blocking(device, False)
    is_open = threading.Event()
    is_open.set()

    def send() -> None:
        while is_open.is_set():
            with suppress(BlockingIOError):
                os.write(device, 64 * b"\x55")
            time.sleep(0.0005)

    sender = threading.Thread(target=send)
    sender.start()
    line = ServoLine(os.ttyname(port), servo_id=9, baud=BAUD, reply_s=0.02)
    begin_s = time.monotonic()
    with pytest.raises(DeviceError):
        line.read(x.MODEL_NUMBER)
    took_s = time.monotonic() - begin_s
    is_open.clear()
    sender.join()
    line.close()
    os.close(device)
    os.close(port)
    assert took_s < 1.0


_OPEN_AS_USER = (
    "import os, sys\n"
    "if os.getuid() == 0: os.setuid(65534)\n"
    "try: os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)\n"
    "except OSError as error: sys.exit(error.errno)\n"
)


def test_servo_line_claims_its_port_until_it_is_closed(bus: ServoBus) -> None:
    os.chmod(bus.name, 0o666)
    line = ServoLine(bus.name, servo_id=9, baud=BAUD)
    status = []
    for _ in range(2):
        command = [sys.executable, "-S", "-c", _OPEN_AS_USER, bus.name]
        status.append(subprocess.run(command, check=False).returncode)
        line.close()
    assert status == [errno.EBUSY, 0]


@pytest.mark.slow
def test_servo_drivers_import_where_there_is_no_termios() -> None:
    program = (
        "import sys, types\n"
        "sys.modules.update(termios=None, fcntl=None, serial=types.ModuleType('serial'))\n"
        "import palpate.gripper.dynamixel, palpate.gripper.feetech\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(
    "register",
    [
        x.DRIVE_MODE,
        x.OPERATING_MODE,
        x.GOAL_CURRENT,
        x.PROFILE_ACCELERATION,
        x.TORQUE_ENABLE,
        x.BUS_WATCHDOG,
    ],
)
def test_dynamixel_setup_raises_if_a_register_does_not_keep_its_value(
    world: World, bus: ServoBus, register: x.Register
) -> None:
    bus.set(x.DRIVE_MODE, x.TIME_BASED)
    bus.set(x.PROFILE_ACCELERATION, 30)
    bus.failing_registers.add(register)
    with pytest.raises(DeviceError, match=f"at address {register.address} after it was set to"):
        open_servo(world, bus)
    if register not in (x.TORQUE_ENABLE, x.BUS_WATCHDOG):
        assert bus.value(x.TORQUE_ENABLE) == 0, "torque must stay off until the setup is confirmed"


def test_servo_line_locks_its_port(gripper: DynamixelGripper, bus: ServoBus) -> None:
    with pytest.raises(DeviceError, match=r"is in use by another program; `fuser -v"):
        ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=REPLY_S)
    gripper.state()
    gripper.close()
    ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=REPLY_S).close()


def test_dynamixel_yields_at_its_current_limit() -> None:
    world = make_world("rigid", "rigid-block")
    bus = ServoBus(world)
    gripper = open_servo(world, bus, current_limit_ma=150.0)
    gripper.command(GripperCommand(target=30.0, rate=20.0))
    for _ in range(120):
        world.clock.sleep_s(0.02)
        gripper.state()
    # 14 mA per newton, plus or minus friction.
    assert 4.0 < world.force_n(world.clock.now_s()) < 15.0
    assert not gripper.state().moving
    gripper.close()
    bus.close()


def test_dynamixel_watchdog_stops_the_servo_until_the_next_command(
    gripper: DynamixelGripper, world: World
) -> None:
    close_slowly(gripper)
    pass_time(world, 1.0)
    # 0.5 s plus one time step.
    assert world.drive_value(1.0) == pytest.approx(74.0 - 0.51 * 4.4, abs=0.4)
    assert not gripper.state().moving
    gripper.stop()
    close_slowly(gripper)
    assert gripper.state().moving


def test_dynamixel_stops_after_the_host_process_is_killed(world: World, bus: ServoBus) -> None:
    program = (
        "import sys, time; from palpate.gripper.dynamixel import open_gripper;"
        "from palpate.gripper.interface import GripperCommand;"
        "g = open_gripper(port=sys.argv[1], reply_s=0.5);"
        "g.command(GripperCommand(target=40.0, rate=5.0));"
        "print('closing', flush=True); time.sleep(60)"
    )
    host = subprocess.Popen([sys.executable, "-c", program, bus.name], stdout=subprocess.PIPE)
    assert host.stdout.readline() == b"closing\n"
    host.send_signal(signal.SIGKILL)
    assert host.wait() == -signal.SIGKILL
    host.stdout.close()
    moving = []
    for _ in range(60):
        world.clock.sleep_s(0.01)
        moving.append(world.is_moving(world.clock.now_s()))
    assert all(moving[:48])
    assert not any(moving[51:])


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        (
            {"port": "/dev/no-such-servo"},
            DeviceNotFoundError,
            "no port /dev/no-such-servo; `palpate ports`",
        ),
        ({"baud": 12345}, InputError, "baud 12345: must be one of 9600, 57600, 115200"),
        ({"servo_id": 3}, DeviceTimeoutError, "servo 3"),
        ({"servo_id": 254}, InputError, "servo_id 254: must be 0 to 252"),
        ({"servo_id": 0.5}, InputError, "servo_id 0.5: must be a whole number from 0 to 252"),
        ({"servo_id": "9"}, InputError, "servo_id '9': must be a number, 0 to 252"),
        ({"reply_s": math.nan}, InputError, "reply_s nan: must be 0.005 to 2 s"),
        ({"offset_mm": 1e9}, InputError, "offset_mm 1000000000: must be -300 to 300 mm"),
        ({"homing_offset": 2_000_000}, InputError, "must be -1044479 to 1044479"),
        ({"lowest_mm": 40.0, "highest_mm": 30.0}, InputError, "lowest_mm is the smaller one"),
        ({"highest_mm": math.inf}, InputError, "highest_mm inf"),
        ({"lowest_mm": 3.0}, InputError, "carriages move from 20 to 76 mm"),
    ],
)
def test_open_dynamixel_gripper_with_invalid_options_raises_one_line(
    bus: ServoBus, options: dict[str, object], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words) as raised:
        open_gripper(**{"port": bus.name, **options})  # type: ignore[arg-type]
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_dynamixel_gripper_is_opened_from_a_rig_file(
    world: World, bus: ServoBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calibration = calibrate_once(seed=5, level="lab", apart_from="strawberry")
    calibration.save(tmp_path / "pad.json")
    opener = SimpleNamespace(array=lambda: TwinArray(world))
    monkeypatch.setitem(sys.modules, "my_bench", opener)
    path = tmp_path / "rig.toml"
    path.write_text(
        "calibration = 'pad.json'\n[array]\nopen = 'my_bench:array'\n[gripper]\n"
        f"open = 'palpate.gripper.dynamixel:open_gripper'\nport = '{bus.name}'\noffset_mm = -4.0\n"
        "reply_s = 0.5\n"
    )
    gripper = open_rig(str(path)).gripper
    assert gripper.limits.highest == 70.0
    assert gripper.state().width_mm == pytest.approx(70.0, abs=0.05)
    gripper.close()


@pytest.mark.slow
def test_rig_file_with_the_array_s_port_in_gripper_names_both_tables(
    world: World, bus: ServoBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The refusal alone would blame another program."""
    calibrate_once(seed=5, level="lab", apart_from="strawberry").save(tmp_path / "pad.json")
    streams = []

    def open_array(port: str) -> TwinArray:
        streams.append(SerialStream(port))
        return TwinArray(world)

    monkeypatch.setitem(sys.modules, "my_bench", SimpleNamespace(array=open_array))
    (tmp_path / "link").symlink_to(bus.name)
    path = tmp_path / "rig.toml"
    path.write_text(
        "calibration = 'pad.json'\n[array]\nopen = 'my_bench:array'\n"
        f"port = '{bus.name}'\n[gripper]\nopen = 'palpate.gripper.dynamixel:open_gripper'\n"
        f"port = '{tmp_path / 'link'}'\n"
    )
    with pytest.raises(InputError, match=r"\[gripper\] port = .*link' is also that of \[array\]"):
        open_rig(str(path))
    streams[0].close()


def test_dynamixel_unknown_model_is_refused(world: World, bus: ServoBus) -> None:
    other = ServoBus(world, model_number=0x1234)
    with pytest.raises(DeviceError, match="model number 4660, which is not supported"):
        open_servo(world, other)
    other.close()


# -- in a grasp ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plan() -> Plan:
    world = make_world("rigid")
    bus = ServoBus(world)
    gripper = open_servo(world, bus)
    calibration = calibrate_once(seed=5, level="lab", apart_from="strawberry")
    plan = plan_grasp(calibration, gripper=gripper)
    gripper.close()
    bus.close()
    return plan


@pytest.mark.slow
def test_paper_method_with_the_dynamixel_gripper_holds_and_measures(
    plan: Plan, gripper: DynamixelGripper, world: World
) -> None:
    calibration = calibrate_once(seed=5, level="lab", apart_from="strawberry")
    paper_plan = use_paper_method(plan, Paper(), calibration=calibration)
    result = run_grasp(paper_plan, array=TwinArray(world), gripper=gripper, clock=world.clock)
    truth = world.truth()
    assert result.outcome is Outcome.HELD
    assert result.faults == ()
    # The tolerance of the size is two steps of 1 mm, as with the twin's own fingers.
    assert abs(result.size_mm.value - truth.size_mm) < 2.0
    assert result.settled_percent.value == pytest.approx(truth.settled_percent, rel=0.2)
    assert gripper.state().width_mm > 73.0


def test_grasp_with_the_dynamixel_gripper_holds_and_measures(
    plan: Plan, gripper: DynamixelGripper, world: World
) -> None:
    result = run_grasp(plan, array=TwinArray(world), gripper=gripper, clock=world.clock)
    truth = world.truth()
    assert result.outcome is Outcome.HELD
    assert result.faults == ()
    assert abs(result.size_mm.value - truth.size_mm) < 1.0
    # One interval in ten misses the truth, so that this test checks the error instead.
    assert abs(result.force_n.value - truth.force_n) < 0.2 * truth.force_n
    assert not truth.damaged
    assert gripper.state().width_mm > 73.0


FAULTS: dict[str, tuple[Callable[[ServoBus], None], str]] = {
    "port vanishes": (lambda bus: bus.unplug(), "the port is gone"),
    "no reply": (lambda bus: setattr(bus, "silent", True), "does not reply"),
    "wrong CRC": (lambda bus: setattr(bus, "damaged_replies", 10**6), "replies are damaged"),
    "overload": (lambda bus: bus.fail(x.HardwareError.OVERLOAD), "overload"),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("at_force_n", [None, 1.0])
def test_grasp_ends_at_once_after_a_servo_fault(
    plan: Plan,
    bus: ServoBus,
    gripper: DynamixelGripper,
    world: World,
    tmp_path: Path,
    fault: str,
    at_force_n: float | None,
) -> None:
    inject, words = FAULTS[fault]
    injected_s: list[float] = []

    def inject_fault(observation: Observation) -> None:
        now_s = world.clock.now_s()
        is_due = now_s > 2.0 if at_force_n is None else world.force_n(now_s) > at_force_n
        if is_due and not injected_s:
            injected_s.append(now_s)
            inject(bus)

    path = tmp_path / "fault.mcap"
    result = run_recorded_grasp(
        plan, world, TwinArray(world), gripper, path, subscribers=[inject_fault]
    )
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert words in result.faults[0]
    assert world.clock.now_s() - injected_s[0] <= 0.1
    assert len(load_recording(path).time_s) == result.frames
    world.clock.sleep_s(1.0)
    assert not world.is_moving(world.clock.now_s())
    if at_force_n is not None:
        assert world.force_n(world.clock.now_s()) > 0.0, "the object must not be dropped"


def test_grasp_ends_after_lost_torque_and_names_it(
    plan: Plan, bus: ServoBus, gripper: DynamixelGripper, world: World, tmp_path: Path
) -> None:
    injected_s: list[float] = []

    def switch_torque_off(_: Observation) -> None:
        if world.clock.now_s() > 1.0 and not injected_s:
            injected_s.append(world.clock.now_s())
            bus.fail(x.HardwareError(0))

    path = tmp_path / "fault.mcap"
    result = run_recorded_grasp(
        plan, world, TwinArray(world), gripper, path, subscribers=[switch_torque_off]
    )
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert "without torque: its supply was interrupted" in result.faults[0]
    # The stop first looks like a contact. It is detected after a half step without movement.
    assert world.clock.now_s() - injected_s[0] <= 0.7 + 2 * 0.55
    assert len(load_recording(path).time_s) == result.frames
    assert not world.is_moving(world.clock.now_s())
