"""The firmware between a twin's world and a host: pixels in, a pseudo-terminal out, one clock."""

from __future__ import annotations

import os
import select
import tty

from palpate.errors import DeviceError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.serial_array import SerialArray
from palpate.twin.firmware import FirmwareBoard
from palpate.twin.stage import Stage

#: The pixels' voltages are taken from the world this often; a scan of 8 pixels lasts 1 ms.
_STEP_S = 0.004
#: The kernel passes bytes through a pseudo-terminal at once; far longer means that it won't.
_KERNEL_S = 5.0
_CHUNK = 1024


class FirmwareStream:
    """A `ByteStream` whose other end is the simulated board, wired to a world's pixels.

    Bytes go through a real pseudo-terminal and pyserial. Each call lets the board run up to the
    world's clock, and waits until the kernel has passed on every byte, so that runs repeat exactly.

    Parameters
    ----------
    world : Stage
        Where the voltages come from; the board is powered up at its present time.
    board : FirmwareBoard
        Just made; it is closed with the stream.
    """

    def __init__(self, world: Stage, *, board: FirmwareBoard) -> None:
        self._world, self._board = world, board
        self._power_up_s = world.clock.now_s()
        self._stepped_s = -1.0
        self._inside = False
        self._backlog = bytearray()
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        self._host = SerialStream(self.name)
        self._slave = slave
        self._open = True
        world.watchers.append(self._run_until)

    def read_waiting(self) -> bytes:
        """Return all bytes that the board has sent by now."""
        self._run_until(self._world.clock.now_s())
        received = bytearray()
        while self._backlog:
            part = bytes(self._backlog[:_CHUNK])
            del self._backlog[: len(part)]
            os.write(self._master, part)
            wanted = len(received) + len(part)
            while len(received) < wanted:
                self._wait_for(self._slave)
                received += self._host.read_waiting()
        return bytes(received)

    def write(self, data: bytes) -> None:
        """Send `data`; it travels to the board at the speed of the line."""
        self._run_until(self._world.clock.now_s())
        self._host.write(data)
        left = len(data)
        while left:
            self._wait_for(self._master)
            part = os.read(self._master, left)
            self._board.write_bytes(part)
            left -= len(part)

    def close(self) -> None:
        """Switch the board off and take the terminal away; calling it again does nothing."""
        if not self._open:
            return
        self._open = False
        self._world.watchers.remove(self._run_until)
        self._host.close()
        os.close(self._slave)
        os.close(self._master)
        self._board.close()

    def _run_until(self, time_s: float) -> None:
        # Asking the world for voltages calls its watchers, and so this again.
        if self._inside:
            return
        self._inside = True
        try:
            while self._stepped_s + _STEP_S <= time_s:
                self._stepped_s = max(self._stepped_s + _STEP_S, self._power_up_s)
                self._board_to(self._stepped_s)
                self._board.set_pixels_mv(1e3 * self._world.pixel_voltage_v(self._stepped_s))
            self._board_to(time_s)
        finally:
            self._inside = False

    def _board_to(self, time_s: float) -> None:
        self._board.run_until(time_s - self._power_up_s)
        self._backlog += self._board.read_bytes()

    def _wait_for(self, terminal: int) -> None:
        if not select.select([terminal], [], [], _KERNEL_S)[0]:
            raise DeviceError(f"{self.name}: the kernel did not pass bytes on in {_KERNEL_S:g} s")


def open_firmware_array(world: Stage, *, noise_mv: float, rate_hz: float) -> SerialArray:
    """Return the serial array of a board that scans the world's pixels.

    Parameters
    ----------
    world : Stage
        Moves with its clock; the array moves that clock while it waits, as `TwinArray` does.
    noise_mv : float
        Standard deviation of the converter's noise.
    rate_hz : float
        Frames per second.

    Raises
    ------
    DeviceNotFoundError
        If firmware or simulator have not been built; the message says what to install.
    DeviceError
        If the firmware can't do that rate.
    """
    board = FirmwareBoard(seed=world.seed)
    board.set_noise_mv(noise_mv)
    stream = FirmwareStream(world, board=board)
    layout: ArrayLayout = world.layout
    return SerialArray(
        stream,
        clock=world.clock,
        layout=layout,
        rate_hz=rate_hz,
        oversampling=world.oversampling,
    )
