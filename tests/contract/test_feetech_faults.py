"""The Feetech driver with a silent or overloaded servo, and with a silent host."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from tests.conftest import calibrate_once
from tests.contract.hands import (
    CLOSED_TICK,
    JAW,
    REPLY_S,
    make_world,
    open_jaw,
    pass_time,
    read_for,
)
from tests.contract.sts_bus import StsBus

from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, InputError
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper import sts_series as sts
from palpate.gripper.feetech import FeetechGripper, open_gripper
from palpate.gripper.fingers import HingedJaw
from palpate.gripper.interface import GripperCommand, open_fully
from palpate.gripper.packets import PROTOCOL_1, Register
from palpate.gripper.servo_line import ServoLine
from palpate.twin.devices import TwinArray
from palpate.twin.world import World


@pytest.fixture
def world() -> World:
    return make_world("rigid", "strawberry")


@pytest.fixture
def bus(world: World) -> Iterator[StsBus]:
    found = StsBus(world, jaw=JAW, closed_tick=CLOSED_TICK)
    yield found
    found.close()


@pytest.fixture
def gripper(world: World, bus: StsBus) -> Iterator[FeetechGripper]:
    found = open_jaw(world, bus)
    yield found
    found.close()


def test_protocol_1_packets_equal_the_examples_in_the_manual() -> None:
    # Ping of servo 1, and read of its position; the SDK adds header and checksum.
    assert PROTOCOL_1.build_request(1, 1, b"") == [0, 0, 1, 2, 1, 0]
    encode = PROTOCOL_1.encode_word
    requested = encode(sts.PRESENT_POSITION.address) + encode(sts.PRESENT_POSITION.size)
    assert PROTOCOL_1.build_request(1, 2, requested) == [0, 0, 1, 4, 2, 0x38, 2, 0]
    assert PROTOCOL_1.is_reply_from([0xFF, 0xFF, 1, 4, 0, 0x18, 0x05, 0xDD], servo_id=1, size=2)
    assert not PROTOCOL_1.is_reply_from([0xFF, 0xFF, 1, 4, 0, 0x18, 0x05, 0xDD], servo_id=2, size=2)
    assert not PROTOCOL_1.is_reply_from([0xFF, 0xFF, 1, 2, 0, 0xFC], servo_id=1, size=2)


def test_feetech_closing_stops_within_the_leash_if_the_host_is_silent(
    gripper: FeetechGripper, world: World
) -> None:
    sent = gripper.command(GripperCommand(target=10.0, rate=10.0))
    assert sent.target == pytest.approx(10.0, abs=0.1)
    pass_time(world, 3.0)
    # At most 0.5 s at 10 mm/s (a wide jaw closes more slowly).
    assert 69.0 <= world.drive_value(world.clock.now_s()) <= 71.0
    assert not world.is_moving(world.clock.now_s())
    gripper.state()
    pass_time(world, 3.0)
    assert 64.0 <= world.drive_value(world.clock.now_s()) <= 67.0


def test_feetech_opening_completes_without_the_host(gripper: FeetechGripper, world: World) -> None:
    gripper.command(GripperCommand(target=70.0, rate=60.0))
    pass_time(world, 0.5)
    gripper.release()
    pass_time(world, 3.0)
    assert world.drive_value(world.clock.now_s()) == pytest.approx(74.0, abs=0.1)


def test_feetech_yields_at_its_torque_limit() -> None:
    world = make_world("rigid", "rigid-block")
    bus = StsBus(world, jaw=JAW, closed_tick=CLOSED_TICK)
    gripper = open_jaw(world, bus, torque_limit_percent=20.0)
    gripper.command(GripperCommand(target=30.0, rate=20.0))
    for _ in range(200):
        world.clock.sleep_s(0.02)
        gripper.state()
    assert 5.0 < world.force_n(world.clock.now_s()) < 12.0
    gripper.close()
    bus.close()


@pytest.mark.slow
def test_feetech_retries_damaged_replies_and_raises_without_a_reply(
    gripper: FeetechGripper, bus: StsBus
) -> None:
    bus.damaged_replies = 2
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.1)
    bus.silent = True
    for method in (gripper.state, gripper.stop):
        with pytest.raises(DeviceTimeoutError, match=r"servo 6 on /dev/pts/\d+ does not reply"):
            method()


def test_feetech_state_raises_with_the_reported_protection_states(
    gripper: FeetechGripper, bus: StsBus
) -> None:
    bus.state = sts.State.OVERHEATING | sts.State.OVERLOAD
    with pytest.raises(DeviceError, match="protects itself: overheating, overload"):
        gripper.state()


def test_feetech_setup_does_not_move_to_an_old_goal(world: World, bus: StsBus) -> None:
    """An earlier program has set a goal and switched the torque off."""
    line = ServoLine(bus.name, servo_id=6, baud=1_000_000, reply_s=REPLY_S, packets=PROTOCOL_1)
    line.write(sts.GOAL_POSITION, CLOSED_TICK)
    line.close()
    gripper = open_jaw(world, bus)
    pass_time(world, 1.0)
    assert world.drive_value(world.clock.now_s()) == pytest.approx(74.0, abs=0.1)
    gripper.close()


def test_feetech_setup_overwrites_settings_of_an_earlier_host(world: World, bus: StsBus) -> None:
    bus.set(sts.ACCELERATION, 50)
    open_jaw(world, bus, torque_limit_percent=20.0).close()
    wanted = {sts.ACCELERATION: 0, sts.TORQUE_LIMIT: 200, sts.TORQUE_ENABLE: 1}
    assert {register: bus.value(register) for register in wanted} == wanted


@pytest.mark.parametrize("register", [sts.TORQUE_LIMIT, sts.ACCELERATION, sts.TORQUE_ENABLE])
def test_feetech_setup_raises_if_a_register_does_not_keep_its_value(
    world: World, bus: StsBus, register: Register
) -> None:
    bus.set(sts.ACCELERATION, 50)
    bus.failing_registers.add(register)
    with pytest.raises(DeviceError, match=f"at address {register.address} after it was set to"):
        open_jaw(world, bus)
    assert bus.value(sts.TORQUE_ENABLE) == 0


@pytest.mark.parametrize(
    ("register", "value", "remedy"),
    [
        (sts.MIN_POSITION_LIMIT, 1100, "Set it to 1047 or less"),
        (sts.MAX_POSITION_LIMIT, 1600, "Set it to 1726 or more"),
        (sts.HOMING_OFFSET, 85, "add homing_offset = 85"),
        (sts.HOMING_OFFSET, -1200, "Set the register to 0"),
        (sts.PHASE, 8, "Set bit 2 (4)"),
        (sts.PHASE, 13, "Set bits 0 (1) and 7 (128) to the same value"),
        (sts.PHASE, 140, "Set bits 0 (1) and 7 (128) to the same value"),
        (sts.OPERATING_MODE, 3, "is in operating mode 3; set"),
        (sts.RESPONSE_LEVEL, 0, "Set it to 1"),
        (sts.MAX_TORQUE_LIMIT, 200, "torque_limit_percent 30: must be above 0 and at most 20"),
    ],
)
def test_feetech_stored_setting_that_misleads_the_jaw_is_refused(
    world: World, bus: StsBus, register: Register, value: int, remedy: str
) -> None:
    bus.set(register, value)
    with pytest.raises((DeviceError, InputError)) as raised:
        open_jaw(world, bus)
    assert f"{register.name} (address {register.address})" in str(raised.value)
    assert remedy in str(raised.value)
    assert "\n" not in str(raised.value)
    assert bus.value(sts.TORQUE_ENABLE) == 0


def test_feetech_stored_settings_that_do_no_harm_are_accepted(world: World, bus: StsBus) -> None:
    """No limits, both directions reversed, and an offset that the rig file knows."""
    bus.set(sts.MAX_POSITION_LIMIT, 0)
    bus.set(sts.PHASE, 12 + 1 + 128)
    bus.set(sts.HOMING_OFFSET, -85)
    bus.position_error = -85
    gripper = open_jaw(world, bus, homing_offset=-85)
    gripper.command(GripperCommand(target=60.0, rate=20.0))
    for _ in range(20):
        world.clock.sleep_s(0.1)
        gripper.state()
    assert world.drive_value(world.clock.now_s()) == pytest.approx(60.0, abs=0.1)
    gripper.close()


@pytest.mark.parametrize(
    ("model_number", "ticks", "phase", "words"),
    [
        (777, 4096, 28, "Present_Position (address 56) is 5822, but goals are 0 to 4095"),
        (2825, -4096, 28, "clear bit 4 (16) of Phase (address 18), which is 28"),
        (777, -2048, 28, "is -322, but goals are 0 to 4095"),
        (777, -2048, 12, "outside the fingers' travel of 1000 to 1726"),
        (2825, 300, 12, "is 2026, 26° outside the fingers' travel of 1000 to 1726"),
        (777, -900, 12, "With opens = -1 the jaw would be within: check opens (1) first"),
    ],
)
def test_feetech_outside_its_travel_is_refused(
    world: World, model_number: int, ticks: int, phase: int, words: str
) -> None:
    bus = StsBus(world, jaw=JAW, closed_tick=CLOSED_TICK, model_number=model_number)
    bus.set(sts.PHASE, phase)
    bus.position_error = ticks
    with pytest.raises(DeviceError) as raised:
        open_jaw(world, bus)
    assert words in str(raised.value)
    assert bus.value(sts.TORQUE_ENABLE) == 0
    bus.close()


@pytest.mark.parametrize(("ticks", "closed_tick"), [(50, CLOSED_TICK), (1500, CLOSED_TICK + 1500)])
def test_feetech_at_its_end_stop_is_accepted(
    world: World, bus: StsBus, ticks: int, closed_tick: int
) -> None:
    bus.position_error = ticks
    gripper = open_gripper(
        port=bus.name, jaw_mm=70.0, closed_tick=closed_tick, highest_mm=74.0, reply_s=REPLY_S
    )
    assert gripper.state().width_mm == pytest.approx(76.0, abs=2.5)
    gripper.close()


def test_feetech_that_opens_in_the_other_direction_is_refused(world: World, bus: StsBus) -> None:
    with pytest.raises(DeviceError, match="With opens = 1 the jaw would be within"):
        open_gripper(
            port=bus.name,
            jaw_mm=70.0,
            closed_tick=CLOSED_TICK,
            highest_mm=74.0,
            opens=-1,
            reply_s=REPLY_S,
        )


@pytest.mark.parametrize(
    ("clips_to", "target_mm", "found"),
    [((1100, 4095), 8.0, 1100), ((0, 1500), 60.0, 1500), ((1300, 1400), 5.0, 1300)],
)
def test_feetech_that_shortens_its_goals_is_a_fault(
    world: World,
    bus: StsBus,
    gripper: FeetechGripper,
    clips_to: tuple[int, int],
    target_mm: float,
    found: int,
) -> None:
    gripper.command(GripperCommand(target=40.0, rate=60.0))
    bus.clips_to = clips_to
    gripper.command(GripperCommand(target=target_mm, rate=60.0))
    with pytest.raises(DeviceError) as raised:
        read_for(world, gripper, 3)
    message = str(raised.value)
    assert f"Goal_Position (address 42) is {found}" in message
    assert "Min_Position_Limit (address 9), now 0" in message


@pytest.mark.parametrize("ticks", [-80, -300, -700])
def test_feetech_at_its_end_stop_before_its_goal_names_the_zero_position(
    world: World, bus: StsBus, ticks: int
) -> None:
    bus.position_error = ticks
    gripper = open_jaw(world, bus)
    with pytest.raises(DeviceError, match=r"end stop.* read closed_tick \(1000\) again"):
        open_fully(gripper, clock=world.clock)
    gripper.stop()
    gripper.close()


def test_feetech_closing_blocked_by_an_object_is_no_fault() -> None:
    world = make_world("rigid", "rigid-block")
    bus = StsBus(world, jaw=JAW, closed_tick=CLOSED_TICK)
    gripper = open_jaw(world, bus)
    gripper.command(GripperCommand(target=5.0, rate=60.0))
    state = read_for(world, gripper, 3.0)
    assert not state.moving
    open_fully(gripper, clock=world.clock)
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.1)
    gripper.close()
    bus.close()


@pytest.mark.parametrize("torque", [0, 1])
@pytest.mark.parametrize(
    ("state", "cause"),
    [
        (sts.State.VOLTAGE, "supply is at 12.3 V now (4.0 to 8.0 V are allowed)"),
        (sts.State.OVERHEATING, "servo is at 71 °C"),
        (sts.State.OVERCURRENT, "load was too large"),
        (sts.State.OVERLOAD, "load was too large"),
        (sts.State.ENCODER, "position sensor"),
        (sts.State(0x10), "error 0x10"),
    ],
)
def test_feetech_error_names_its_cause_and_the_torque(
    gripper: FeetechGripper, bus: StsBus, state: sts.State, cause: str, torque: int
) -> None:
    bus.set(sts.PRESENT_VOLTAGE, 123)
    bus.set(sts.PRESENT_TEMPERATURE, 71)
    bus.set(sts.TORQUE_ENABLE, torque)
    bus.state = state
    with pytest.raises(DeviceError, match=f"torque is {['off', 'on'][torque]}") as raised:
        gripper.state()
    assert cause in str(raised.value)


def test_feetech_cycle_needs_two_exchanges(
    gripper: FeetechGripper, bus: StsBus, world: World
) -> None:
    gripper.command(GripperCommand(target=20.0, rate=10.0))
    before = bus.packets
    for _ in range(15):
        world.clock.sleep_s(1 / 15)
        gripper.state()
        gripper.command(GripperCommand(target=20.0, rate=10.0))
    assert bus.packets - before == 30
    before = bus.packets
    for _ in range(50):
        world.clock.sleep_s(1 / 50)
        gripper.state()
    # A further goal is needed for each quarter of the leash of 0.5 s.
    assert bus.packets - before <= 60
    assert gripper.state().moving


def test_feetech_near_half_a_turn_keeps_to_the_servo_s_speed() -> None:
    """The slope is 0 there, and the speed for a rate has no bound."""
    world = make_world("rigid")
    jaw = HingedJaw(jaw_mm=37.0)
    bus = StsBus(world, jaw=jaw, closed_tick=CLOSED_TICK)
    gripper = open_gripper(
        port=bus.name, jaw_mm=37.0, closed_tick=CLOSED_TICK, highest_mm=74.0, reply_s=REPLY_S
    )
    gripper.command(GripperCommand(target=74.0, rate=60.0))
    assert bus.value(sts.GOAL_VELOCITY) == sts.MAX_VELOCITY
    gripper.close()
    bus.close()


def test_feetech_stop_on_the_leash_cancels_the_remaining_travel(
    gripper: FeetechGripper, world: World
) -> None:
    """After a stop the servo stays, although its target is further closed."""
    gripper.command(GripperCommand(target=40.0, rate=10.0))
    pass_time(world, 3.0)
    gripper.stop()
    stopped_mm = world.drive_value(world.clock.now_s())
    for _ in range(10):
        gripper.state()
        pass_time(world, 0.3)
    assert world.drive_value(world.clock.now_s()) == pytest.approx(stopped_mm, abs=0.05)
    assert not gripper.state().moving


def test_feetech_state_on_a_lost_port_raises(gripper: FeetechGripper, bus: StsBus) -> None:
    bus.unplug()
    with pytest.raises(DeviceError, match="the port is gone"):
        gripper.state()


def test_feetech_unknown_model_is_refused(world: World) -> None:
    other = StsBus(world, jaw=JAW, closed_tick=CLOSED_TICK, model_number=9)
    with pytest.raises(DeviceError, match="model number 9, which is not supported; use STS3215"):
        open_jaw(world, other)
    other.close()


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        (
            {"port": "/dev/no-such-servo"},
            DeviceNotFoundError,
            "no port /dev/no-such-servo; `palpate ports`",
        ),
        ({"highest_mm": 300.0}, InputError, "the jaw opens from 0 to 140 mm"),
        ({"closed_tick": 4000}, InputError, "remount its horn"),
        ({"closed_tick": 4400}, InputError, "closed_tick 4400: must be 0 to 4095"),
        ({"closed_tick": 0.5}, InputError, "must be a whole number from 0 to 4095"),
        ({"jaw_mm": -70.0}, InputError, "jaw_mm -70: must be 10 to 300 mm"),
        ({"servo_id": 254}, InputError, "servo_id 254: must be 0 to 253"),
        ({"baud": 250}, InputError, "baud 250: must be one of 38400"),
        ({"leash_s": math.nan}, InputError, "leash_s nan: must be 0.05 to 2 s"),
        ({"homing_offset": 3000}, InputError, "homing_offset 3000: must be -2047 to 2047"),
        ({"lowest_mm": 40.0, "highest_mm": 30.0}, InputError, "lowest_mm is the smaller one"),
        ({"torque_limit_percent": 0.0}, InputError, "must be 1 to 100"),
        ({"opens": 2}, InputError, "opens 2"),
    ],
)
def test_open_feetech_gripper_with_invalid_options_raises_one_line(
    bus: StsBus, options: dict[str, object], error: type[Exception], words: str
) -> None:
    given = {"port": bus.name, "jaw_mm": 70.0, "closed_tick": CLOSED_TICK, "highest_mm": 70.0}
    with pytest.raises(error, match=words) as raised:
        open_gripper(**{**given, **options})  # type: ignore[arg-type]
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_grasp_with_the_feetech_jaw_holds_and_measures_the_object(
    gripper: FeetechGripper, world: World
) -> None:
    calibration = calibrate_once(seed=5, level="lab", apart_from="strawberry")
    plan = plan_grasp(calibration, gripper=gripper)
    result = run_grasp(plan, array=TwinArray(world), gripper=gripper, clock=world.clock)
    truth = world.truth()
    assert result.outcome is Outcome.HELD, result.faults
    assert abs(float(result.size_mm.value or 0.0) - truth.size_mm) < 1.0
    assert not truth.damaged
    assert gripper.state().width_mm > 73.0
