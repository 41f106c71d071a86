"""A board with its original bootloader: connection, resets and watchdog."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from tests.fixtures import skip

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

#: Bootloaders of Debian's package arduino-core-avr. Its Optiboot for the Uno exceeds the available
#: flash and runs on no board.
FOLDER = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders")
STOCK = {
    "mega2560": FOLDER / "stk500v2/stk500boot_v2_mega2560.hex",
    "nano": FOLDER / "atmega/ATmegaBOOT_168_atmega328.hex",
}
#: Maximum time from a reset to the connection, seconds.
CONNECTED_S = 2.5


@contextmanager
def start_board(
    seed: int = 1, *, name: str = "mega2560"
) -> Iterator[tuple[World, FirmwareBoard, FirmwareStream]]:
    """Yield a board just reset by opening its port, wired to simulated pixels."""
    bootloader = STOCK[name]
    if not bootloader.is_file():
        skip(f"no bootloader at {bootloader}: install arduino-core-avr")
    world = World(None, seed=3, clock=ManualClock(50.0))
    board = FirmwareBoard(name, seed=seed, bootloader=bootloader)
    stream = FirmwareStream(world, board=board)
    try:
        yield world, board, stream
    finally:
        stream.close()


def connect(world: World, stream: FirmwareStream, **options: Contents) -> SerialArray:
    return SerialArray(
        stream, clock=world.clock, layout=RIGID_LAYOUT, rate_hz=50.0, reopen=None, **options
    )


@pytest.mark.parametrize("name", STOCK)
def test_board_that_starts_in_its_bootloader_connects(name: str) -> None:
    for seed in range(2):
        with start_board(seed, name=name) as (world, board, stream):
            begin_s = world.clock.now_s()
            array = connect(world, stream)
            assert array.read(timeout_s=0.2).sequence == 0
            assert 0.5 < world.clock.now_s() - begin_s < CONNECTED_S
            # The bootloader does not switch the safe line; the set-up raises it.
            assert (board.safe_line, board.safe_line_edges) == (True, 1)


def test_board_queried_during_its_bootloader_gives_no_answer() -> None:
    """Bytes sent during the start keep the board in its bootloader."""
    with start_board() as (world, _, stream):
        decoder, found = Decoder(), list[BoardMessage]()
        for tag in range(1, 13):
            stream.write(encode_command(Identify(), tag=tag))
            world.clock.sleep_s(0.3)
            found += decoder.feed(stream.read_waiting())
        assert found == []


@pytest.mark.parametrize(
    ("name", "shown"), [("mega2560", "Arduino Mega 2560"), ("nano", "Arduino Nano")]
)
def test_query_identity_waits_for_the_bootloader(name: str, shown: str) -> None:
    with start_board(name=name) as (world, _, stream):
        begin_s = world.clock.now_s()
        assert query_identity(stream, clock=world.clock).board == shown
        assert world.clock.now_s() - begin_s < CONNECTED_S


#: Maximum time to recover from a hang: 0.25 s of the watchdog and the set-up of a stream, without
#: the bootloader.
RESTARTED_S = {"reset": (0.5, 7.0), "hang": (0.25, 0.5)}


@pytest.mark.parametrize("name", STOCK)
@pytest.mark.parametrize("how", RESTARTED_S)
def test_board_continues_after_a_restart(name: str, how: str) -> None:
    """Pressurized fingers require pings; a reset delays a pending ping.

    The Nano has no pressure. Its bootloader leaves the watchdog on, so that a watchdog reset would
    never end.
    """
    shortest_s, longest_s = RESTARTED_S[how]
    has_pressure = name == "mega2560"
    with start_board(name=name) as (world, board, stream):
        contents = Contents.PRESSURE if has_pressure else Contents.PIXELS
        array = connect(world, stream, contents=contents)
        gripper = PneumaticGripper(array, clock=world.clock) if has_pressure else None
        before_s = [array.read(timeout_s=0.2).time_s for _ in range(10)][-1]
        getattr(board, how)()
        if gripper is not None:
            array.send(Ping())
        after_s = math.nan
        while math.isnan(after_s) and world.clock.now_s() < before_s + 7.0:
            if gripper is not None:
                with suppress(DeviceError):
                    gripper.state()
            with suppress(DeviceTimeoutError):
                found_s = array.read(timeout_s=0.05).time_s
                after_s = found_s if array.counters.restarts else math.nan
        assert shortest_s < after_s - before_s < longest_s
        assert array.counters.restarts == 1
        if has_pressure:
            newest = array.read_newest()
            assert bool(newest.status & BoardStatus.WATCHDOG_RESET) == (how == "hang")
