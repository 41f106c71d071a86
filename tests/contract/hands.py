"""The open grippers of the contract tests, each with a function that advances the time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import numpy as np
from tests.conftest import skip
from tests.contract.regulator_board import RegulatorBoard
from tests.contract.servo_bus import ServoBus
from tests.contract.sts_bus import StsBus

from palpate.clock import ManualClock
from palpate.errors import DeviceNotFoundError
from palpate.gripper.dynamixel import DynamixelGripper
from palpate.gripper.feetech import FeetechGripper
from palpate.gripper.fingers import CrankFingers, HingedJaw
from palpate.gripper.hobby_servo import HobbyServoGripper, ServoTravel
from palpate.gripper.interface import Gripper, GripperLimits, GripperState
from palpate.gripper.packets import PROTOCOL_1
from palpate.gripper.pneumatic import PneumaticGripper
from palpate.gripper.servo_line import ServoLine
from palpate.sensor.array import SOFT_LAYOUT
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import Contents
from palpate.twin.devices import TwinGripper
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.world import World

BAUD = 1_000_000
#: Long, because the servo answers from its own thread on a busy test machine.
REPLY_S = 0.4


@dataclass(frozen=True, kw_only=True)
class Hand:
    """An open gripper, a wait function, and the true finger position (mm or kPa)."""

    gripper: Gripper
    clock: ManualClock
    wait: Callable[[float], None]
    read_position: Callable[[], float]


def open_servo(world: World, bus: ServoBus, **options: float) -> DynamixelGripper:
    """Return the real driver, connected to a simulated servo."""
    line = ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=REPLY_S)
    return DynamixelGripper(line, clock=world.clock, fingers=CrankFingers(), **options)


#: A jaw that opens as wide as the twin's fingers.
JAW, CLOSED_TICK = HingedJaw(jaw_mm=70.0), 1000
JAW_LIMITS = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)


def open_jaw(world: World, bus: StsBus, **options: float) -> FeetechGripper:
    """Return the real driver, connected to a simulated Feetech servo."""
    line = ServoLine(bus.name, servo_id=6, baud=BAUD, reply_s=REPLY_S, packets=PROTOCOL_1)
    return FeetechGripper(
        line, clock=world.clock, jaw=JAW, limits=JAW_LIMITS, closed_tick=CLOSED_TICK, **options
    )


def open_board(world: World, board: RegulatorBoard) -> tuple[SerialArray, PneumaticGripper]:
    """Return the real drivers of array and fingers, connected to a simulated board."""
    array = SerialArray(
        board, clock=world.clock, layout=world.layout, rate_hz=15.0, contents=Contents.PRESSURE
    )
    return array, PneumaticGripper(array, clock=world.clock)


def make_object(name: str) -> TwinObject:
    """Return the object of this name, equal in all worlds of these tests."""
    return draw_object(np.random.default_rng(3), name)


def make_world(kind: str, name: str | None = None) -> World:
    """Return a world with rigid or soft fingers and an optional object."""
    obj = None if name is None else make_object(name)
    return World(obj, seed=5, gripper="soft" if kind == "soft" else "rigid")


@contextmanager
def twin_hand(kind: str) -> Iterator[Hand]:
    world = make_world(kind)
    yield Hand(
        gripper=TwinGripper(world),
        clock=world.clock,
        wait=world.clock.sleep_s,
        read_position=lambda: world.drive_value(world.now_s()),
    )


def _make_servo_hand(world: World, gripper: Gripper) -> Hand:
    def wait(duration_s: float) -> None:
        for _ in range(round(duration_s / 0.1)):
            world.clock.sleep_s(0.1)
            gripper.state()

    return Hand(
        gripper=gripper,
        clock=world.clock,
        wait=wait,
        read_position=lambda: world.drive_value(world.now_s()),
    )


def pass_time(world: World, duration_s: float) -> None:
    """Advance a world in steps of 10 ms without reading the gripper."""
    for _ in range(round(duration_s / 0.01)):
        world.clock.sleep_s(0.01)
        world.drive_value(world.clock.now_s())


def read_for(world: World, gripper: Gripper, duration_s: float) -> GripperState:
    """Advance a world in steps of 50 ms with a reading after each; return the last state."""
    for _ in range(round(duration_s / 0.05)):
        world.clock.sleep_s(0.05)
        state = gripper.state()
    return state


@contextmanager
def servo_hand(model_number: int) -> Iterator[Hand]:
    world = make_world("rigid")
    bus = ServoBus(world, model_number=model_number)
    gripper = open_servo(world, bus)

    yield _make_servo_hand(world, gripper)
    gripper.close()
    bus.close()


@contextmanager
def jaw_hand() -> Iterator[Hand]:
    world = make_world("rigid")
    bus = StsBus(world, jaw=JAW, closed_tick=CLOSED_TICK)
    gripper = open_jaw(world, bus)

    yield _make_servo_hand(world, gripper)
    gripper.close()
    bus.close()


@contextmanager
def board_hand() -> Iterator[Hand]:
    world = make_world("soft")
    board = RegulatorBoard(world)
    array, gripper = open_board(world, board)

    def read_position() -> float:
        board.run()
        return board.pressure_kpa

    wait = _make_wait(array, gripper, world.clock)
    yield Hand(gripper=gripper, clock=world.clock, wait=wait, read_position=read_position)
    gripper.close()
    array.close()


#: Travel of rack fingers that open as wide as the twin's fingers.
TRAVEL = ServoTravel(open_us=690, closed_us=2310, open_mm=74.0, closed_mm=5.0)


def open_hobby_servo(world: World, board: FirmwareBoard) -> tuple[SerialArray, HobbyServoGripper]:
    """Return the array and fingers of a simulated board with a hobby servo."""
    array = SerialArray(
        FirmwareStream(world, board=board, travel=TRAVEL),
        clock=world.clock,
        layout=world.layout,
        rate_hz=50.0,
        contents=Contents.SERVO,
    )
    return array, HobbyServoGripper(array, clock=world.clock, travel=TRAVEL)


@contextmanager
def hobby_hand(kind: str) -> Iterator[Hand]:
    world = make_world("rigid")
    try:
        board = FirmwareBoard(kind, seed=1)
    except DeviceNotFoundError as error:
        skip(str(error))
    array, gripper = open_hobby_servo(world, board)
    wait = _make_wait(array, gripper, world.clock)
    wait(0.3)

    def read_position() -> float:
        array.read(timeout_s=1.0)
        return world.drive_value(world.now_s())

    yield Hand(gripper=gripper, clock=world.clock, wait=wait, read_position=read_position)
    array.close()


@contextmanager
def firmware_hand() -> Iterator[Hand]:
    world = make_world("soft")
    try:
        board = FirmwareBoard(seed=1)
    except DeviceNotFoundError as error:
        skip(str(error))
    stream = FirmwareStream(world, board=board)
    array = SerialArray(
        stream, clock=world.clock, layout=SOFT_LAYOUT, rate_hz=50.0, contents=Contents.PRESSURE
    )
    gripper = PneumaticGripper(array, clock=world.clock)

    def read_position() -> float:
        array.read(timeout_s=1.0)
        return board.pressure_kpa

    wait = _make_wait(array, gripper, world.clock)
    yield Hand(gripper=gripper, clock=world.clock, wait=wait, read_position=read_position)
    gripper.close()
    array.close()


def _make_wait(array: SerialArray, gripper: Gripper, clock: ManualClock) -> Callable[[float], None]:
    """Return a wait function that reads frames and states, like the control loop."""

    def wait(duration_s: float) -> None:
        until_s = clock.now_s() + duration_s
        while clock.now_s() < until_s:
            array.read(timeout_s=1.0)
            gripper.state()

    return wait


#: Opener of each gripper, by name.
HANDS: dict[str, Callable[[], AbstractContextManager[Hand]]] = {
    "twin rigid": lambda: twin_hand("rigid"),
    "twin soft": lambda: twin_hand("soft"),
    "servo with current": lambda: servo_hand(1020),
    "servo without current": lambda: servo_hand(1060),
    "feetech jaw": jaw_hand,
    "board with regulator": board_hand,
    "firmware on the simulator": firmware_hand,
    "hobby servo on a Mega": lambda: hobby_hand("mega2560"),
    "hobby servo on an Uno": lambda: hobby_hand("uno"),
}
#: Hands of the real firmware, whose simulator is built with packages of the system.
ON_FIRMWARE = {"firmware on the simulator", "hobby servo on a Mega", "hobby servo on an Uno"}
