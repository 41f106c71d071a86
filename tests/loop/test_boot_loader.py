"""A board with a boot loader, as sold: connection, resets, watchdog."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from tests.conftest import skip

from palpate.clock import ManualClock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.gripper.pneumatic import PneumaticGripper
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.ports import query_identity
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire import Decoder, encode_command
from palpate.sensor.wire_messages import BoardMessage, BoardStatus, Contents, Identify, Ping
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.world import World

pytestmark = pytest.mark.usefixtures("firmware_built")

#: Of Debian's package arduino-core-avr. Its Optiboot, the Uno's, is longer than the flash has room
#: for and runs on no board.
FOLDER = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders")
STOCK = {
    "mega2560": FOLDER / "stk500v2/stk500boot_v2_mega2560.hex",
    "nano": FOLDER / "atmega/ATmegaBOOT_168_atmega328.hex",
}
#: A board must be connected within this time from its reset, seconds.
CONNECTED_S = 2.5


@contextmanager
def boards(
    seed: int = 1, *, name: str = "mega2560"
) -> Iterator[tuple[World, FirmwareBoard, FirmwareStream]]:
    """Yield a board just reset by opening its port, wired to simulated pixels."""
    boot_loader = STOCK[name]
    if not boot_loader.is_file():
        skip(f"no boot loader at {boot_loader}: install arduino-core-avr")
    world = World(None, seed=3, clock=ManualClock(50.0))
    board = FirmwareBoard(name, seed=seed, boot_loader=boot_loader)
    stream = FirmwareStream(world, board=board)
    try:
        yield world, board, stream
    finally:
        stream.close()


def connected(world: World, stream: FirmwareStream, **options: Contents) -> SerialArray:
    return SerialArray(
        stream, clock=world.clock, layout=RIGID_LAYOUT, rate_hz=50.0, reopen=None, **options
    )


@pytest.mark.parametrize("name", STOCK)
def test_a_board_that_starts_in_its_boot_loader_is_connected(name: str) -> None:
    for seed in range(3):
        with boards(seed, name=name) as (world, _, stream):
            begin_s = world.clock.now_s()
            array = connected(world, stream)
            assert array.read(timeout_s=0.2).sequence == 0
            assert 0.5 < world.clock.now_s() - begin_s < CONNECTED_S


@pytest.mark.parametrize("name", STOCK)
def test_the_boot_loader_does_not_move_the_safe_line(name: str) -> None:
    with boards(name=name) as (world, board, stream):
        array = connected(world, stream)
        array.read(timeout_s=0.2)
        assert (board.safe_line, board.safe_line_edges) == (True, 1), "raised by the set-up"


def test_who_asks_at_once_gets_no_answer() -> None:
    """What the tests here guard against: bytes in time keep the boot loader."""
    with boards() as (world, _, stream):
        decoder, found = Decoder(), list[BoardMessage]()
        for tag in range(1, 13):
            stream.write(encode_command(Identify(), tag=tag))
            world.clock.sleep_s(0.3)
            found += decoder.feed(stream.read_waiting())
        assert found == []


@pytest.mark.parametrize(
    ("name", "shown"), [("mega2560", "Arduino Mega 2560"), ("nano", "Arduino Nano")]
)
def test_ports_flash_and_doctor_ask_in_the_same_way(name: str, shown: str) -> None:
    with boards(name=name) as (world, _, stream):
        begin_s = world.clock.now_s()
        assert query_identity(stream, clock=world.clock).board == shown
        assert world.clock.now_s() - begin_s < CONNECTED_S


#: After a hang the firmware starts again without the boot loader: 0.25 s of the watchdog, and the
#: set-up of a stream.
RESTARTED_S = {"reset": (0.5, 7.0), "hang": (0.25, 0.5)}


@pytest.mark.parametrize("how", RESTARTED_S)
def test_a_mega_that_restarts_goes_on(how: str) -> None:
    """Fingers under pressure are pinged; a reset delays a ping under way."""
    shortest_s, longest_s = RESTARTED_S[how]
    with boards() as (world, board, stream):
        array = connected(world, stream, contents=Contents.PRESSURE)
        gripper = PneumaticGripper(array, clock=world.clock)
        before_s = [array.read(timeout_s=0.2).time_s for _ in range(10)][-1]
        getattr(board, how)()
        array.send(Ping())
        after_s = math.nan
        while math.isnan(after_s) and world.clock.now_s() < before_s + longest_s:
            with suppress(DeviceError):
                gripper.state()
            with suppress(DeviceTimeoutError):
                found_s = array.read(timeout_s=0.05).time_s
                after_s = found_s if array.counters.restarts else math.nan
        assert shortest_s < after_s - before_s < longest_s
        assert array.counters.restarts == 1
        newest = array.newest()
        assert bool(newest.status & BoardStatus.WATCHDOG_RESET) == (how == "hang")


@pytest.mark.parametrize("how", RESTARTED_S)
def test_a_nano_that_restarts_goes_on(how: str) -> None:
    """Its boot loader leaves the watchdog on: a reset by it would never end."""
    shortest_s, longest_s = RESTARTED_S[how]
    with boards(name="nano") as (world, board, stream):
        array = connected(world, stream)
        before_s = [array.read(timeout_s=0.2).time_s for _ in range(10)][-1]
        getattr(board, how)()
        after_s = math.nan
        while math.isnan(after_s) and world.clock.now_s() < before_s + 7.0:
            with suppress(DeviceTimeoutError):
                found_s = array.read(timeout_s=0.05).time_s
                after_s = found_s if array.counters.restarts else math.nan
        assert shortest_s < after_s - before_s < longest_s
        assert array.counters.restarts == 1
