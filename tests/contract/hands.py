"""The open grippers of the contract tests, each with a function that advances the time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from tests.contract.regulator_board import RegulatorBoard
from tests.contract.servo_bus import ServoBus
from tests.fixtures import skip

from palpate.clock import ManualClock
from palpate.errors import DeviceNotFoundError
from palpate.gripper import sts_series as sts
from palpate.gripper.dynamixel import DynamixelGripper
from palpate.gripper.feetech import FeetechGripper
from palpate.gripper.fingers import CrankFingers, HingedJaw
from palpate.gripper.hobby_servo import HobbyServoGripper, ServoTravel
from palpate.gripper.interface import Gripper, GripperCommand, GripperLimits, GripperState
from palpate.gripper.packets import PROTOCOL_1, PROTOCOL_2
from palpate.gripper.pneumatic import PneumaticGripper
from palpate.gripper.servo_line import ServoLine
from palpate.sensor.array import SOFT_LAYOUT
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import Contents
from palpate.twin.devices import TwinGripper
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.sts_bus import StsBus
from palpate.twin.world import World

BAUD = 1_000_000
#: Long, because the servo answers from its own thread on a busy test machine.
REPLY_S = 0.4
#: A jaw that opens as wide as the twin's fingers.
JAW, CLOSED_TICK = HingedJaw(jaw_mm=70.0), 1000
JAW_LIMITS = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)


@dataclass(frozen=True, kw_only=True)
class Hand:
    """An open gripper, a wait function, and the true finger position (mm or kPa)."""

    gripper: Gripper
    clock: ManualClock
    wait: Callable[[float], None]
    read_position: Callable[[], float]


def open_servo(
    world: World, bus: ServoBus, *, reply_s: float = REPLY_S, **options: Any
) -> DynamixelGripper:
    """Return the real driver, connected to a simulated servo."""
    line = ServoLine(bus.name, servo_id=9, baud=BAUD, reply_s=reply_s)
    return DynamixelGripper(line, clock=world.clock, **{"fingers": CrankFingers()} | options)


def open_jaw(
    world: World, bus: StsBus, *, reply_s: float = REPLY_S, **options: Any
) -> FeetechGripper:
    """Return the real driver, connected to a simulated Feetech servo."""
    line = ServoLine(bus.name, servo_id=6, baud=BAUD, reply_s=reply_s, packets=PROTOCOL_1)
    given = {"jaw": JAW, "limits": JAW_LIMITS, "closed_tick": CLOSED_TICK}
    return FeetechGripper(line, clock=world.clock, **given | options)


def pass_time(world: World, duration_s: float) -> None:
    """Advance a world in steps of 10 ms without reading the gripper."""
    for _ in range(round(duration_s / 0.01)):
        world.clock.sleep_s(0.01)
        world.drive_value(world.clock.now_s())


def read_for(
    world: World, gripper: Gripper, duration_s: float, *, every_s: float = 0.05
) -> GripperState:
    """Advance a world with a reading after each step; return the last state."""
    for _ in range(round(duration_s / every_s)):
        world.clock.sleep_s(every_s)
        state = gripper.state()
    return state


class Servo:
    """A simulated servo that moves the fingers of a world, and its driver once it is opened.

    `model`: number of a DYNAMIXEL or Feetech servo. `bus`: options of the simulated servo.
    """

    def __init__(self, model: int, *, world: World | None = None, **bus: Any) -> None:
        self.world, self.gripper = world or make_world("rigid", "strawberry"), None
        self.is_feetech = model in sts.MODELS
        if self.is_feetech:
            bus = {"jaw": JAW, "closed_tick": CLOSED_TICK} | bus
        self.driver: Any = FeetechGripper if self.is_feetech else DynamixelGripper
        make_bus: Any = StsBus if self.is_feetech else ServoBus
        self.bus = make_bus(self.world, model_number=model, **bus)

    def connect(self, *, reply_s: float = REPLY_S) -> ServoLine:
        """Return an open line to the servo."""
        servo_id, packets = (6, PROTOCOL_1) if self.is_feetech else (9, PROTOCOL_2)
        return ServoLine(
            self.bus.name, servo_id=servo_id, baud=BAUD, reply_s=reply_s, packets=packets
        )

    def open(self, *, reply_s: float = REPLY_S, **options: Any) -> Any:
        """Return the real driver, connected to the servo."""
        opened: Any = open_jaw if self.is_feetech else open_servo
        self.gripper = opened(self.world, self.bus, reply_s=reply_s, **options)
        return self.gripper

    def fall_silent(self) -> None:
        """Answer no more; the driver, which was used to a busy machine, waits for 20 ms only."""
        self.bus.silent = True
        self.gripper._line._reply_ms = 20.0

    @property
    def width_mm(self) -> float:
        """The true opening of the fingers."""
        return self.world.drive_value(self.world.clock.now_s())

    @property
    def force_n(self) -> float:
        """The true force between the fingers."""
        return self.world.force_n(self.world.clock.now_s())

    @property
    def is_moving(self) -> bool:
        """Whether the fingers truly move."""
        return self.world.is_moving(self.world.clock.now_s())

    def move(self, target: float, *, rate: float = 60.0) -> GripperCommand:
        """Send a command."""
        sent: GripperCommand = self.gripper.command(GripperCommand(target=target, rate=rate))
        return sent

    def wait(self, duration_s: float) -> None:
        """Advance the world without reading the gripper."""
        pass_time(self.world, duration_s)

    def follow(self, duration_s: float, *, every_s: float = 0.05) -> GripperState:
        """Advance the world with a reading after each step; return the last state."""
        return read_for(self.world, self.gripper, duration_s, every_s=every_s)

    def close(self) -> None:
        """Close the driver and remove the servo; repeatable."""
        if self.gripper is not None:
            self.gripper.close()
        self.bus.close()


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


@contextmanager
def servo_hand(model: int) -> Iterator[Hand]:
    servo = Servo(model, world=make_world("rigid"))
    yield Hand(
        gripper=servo.open(),
        clock=servo.world.clock,
        wait=lambda duration_s: servo.follow(duration_s, every_s=0.1),
        read_position=lambda: servo.width_mm,
    )
    servo.close()


#: Travel of rack fingers that open as wide as the twin's fingers.
TRAVEL = ServoTravel(open_us=690, closed_us=2310, open_mm=74.0, closed_mm=5.0)


def make_firmware_board(kind: str = "mega2560", *, seed: int = 1) -> FirmwareBoard:
    """Return the firmware on a simulated board; skip without the simulator."""
    try:
        return FirmwareBoard(kind, seed=seed)
    except DeviceNotFoundError as error:
        skip(str(error))
        raise


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
def _hand_on_board(
    world: World,
    array: SerialArray,
    gripper: Gripper,
    position: Callable[[], float],
    advance: Callable[[], object] | None = None,
) -> Iterator[Hand]:
    """Yield a hand that waits like the control loop: it reads frames and states."""
    read = partial(array.read, timeout_s=1.0)

    def wait(duration_s: float) -> None:
        until_s = world.clock.now_s() + duration_s
        while world.clock.now_s() < until_s:
            read()
            gripper.state()

    def read_position() -> float:
        (advance or read)()
        return position()

    yield Hand(gripper=gripper, clock=world.clock, wait=wait, read_position=read_position)
    gripper.close()
    array.close()


@contextmanager
def hobby_hand(kind: str) -> Iterator[Hand]:
    world = make_world("rigid")
    array, gripper = open_hobby_servo(world, make_firmware_board(kind))
    with _hand_on_board(world, array, gripper, lambda: world.drive_value(world.now_s())) as hand:
        hand.wait(0.3)
        yield hand


@contextmanager
def board_hand() -> Iterator[Hand]:
    world = make_world("soft")
    board = RegulatorBoard(world)
    array, gripper = open_board(world, board)
    with _hand_on_board(world, array, gripper, lambda: board.pressure_kpa, board.run) as hand:
        yield hand


@contextmanager
def firmware_hand() -> Iterator[Hand]:
    world, board = make_world("soft"), make_firmware_board()
    array = SerialArray(
        FirmwareStream(world, board=board),
        clock=world.clock,
        layout=SOFT_LAYOUT,
        rate_hz=50.0,
        contents=Contents.PRESSURE,
    )
    gripper = PneumaticGripper(array, clock=world.clock)
    with _hand_on_board(world, array, gripper, lambda: board.pressure_kpa) as hand:
        yield hand


#: Opener of each gripper, by name.
HANDS: dict[str, Callable[[], AbstractContextManager[Hand]]] = {
    "twin rigid": lambda: twin_hand("rigid"),
    "twin soft": lambda: twin_hand("soft"),
    "servo with current": lambda: servo_hand(1020),
    "servo without current": lambda: servo_hand(1060),
    "feetech jaw": lambda: servo_hand(777),
    "board with regulator": board_hand,
    "firmware on the simulator": firmware_hand,
    "hobby servo on a Mega": lambda: hobby_hand("mega2560"),
    "hobby servo on an Uno": lambda: hobby_hand("uno"),
}
#: Hands of the real firmware, whose simulator is built with packages of the system.
ON_FIRMWARE = {"firmware on the simulator", "hobby servo on a Mega", "hobby servo on an Uno"}
