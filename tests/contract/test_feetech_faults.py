"""The Feetech driver with a silent or overloaded servo, and with a silent host."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from tests.contract.hands import CLOSED_TICK, JAW, REPLY_S, make_world, open_jaw, pass_time
from tests.contract.sts_bus import StsBus

from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, InputError
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper import sts_series as sts
from palpate.gripper.feetech import FeetechGripper, open_gripper
from palpate.gripper.interface import GripperCommand
from palpate.gripper.packets import PROTOCOL_1, Register
from palpate.gripper.servo_line import ServoLine
from palpate.rig.simulated import calibrate_twin
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
    calibration = calibrate_twin(seed=5, level="lab", apart_from="strawberry")
    plan = plan_grasp(calibration, gripper=gripper)
    result = run_grasp(plan, array=TwinArray(world), gripper=gripper, clock=world.clock)
    truth = world.truth()
    assert result.outcome is Outcome.HELD, result.faults
    assert abs(float(result.size_mm.value or 0.0) - truth.size_mm) < 1.0
    assert not truth.damaged
    assert gripper.state().width_mm > 73.0
