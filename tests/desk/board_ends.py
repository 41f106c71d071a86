"""The boards of the desk: they send bytes by the wall clock, whether or not anyone reads."""

from __future__ import annotations

import math
import os
import select
import tty
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.gripper.hobby_servo import ServoTravel
from palpate.twin.firmware import BoardOnStage, FirmwareBoard
from palpate.twin.ranges import ranges_of
from palpate.twin.world import World

#: Bits of a byte on a serial line: start, eight, stop.
_BITS = 10
#: Bytes that a serial port keeps for a program that does not read (Linux: 64 KB).
_KEPT_BYTES = 1 << 16
_READ_BYTES = 4096


class BoardEnd(Protocol):
    """The device end of a board's serial line."""

    def take_output(self, now_s: float) -> bytes:
        """Return the bytes that have left the board since the last call."""
        ...

    def give(self, data: bytes) -> None:
        """Receive bytes from the host."""
        ...


class OwnFirmware:
    """palpate's firmware on a simulated Mega."""

    def __init__(self, world: World, *, seed: int, travel: ServoTravel | None) -> None:
        board = FirmwareBoard(seed=seed)
        divider = world.layout.divider
        count_mv = 1e3 * divider.supply_v / divider.full_scale
        board.set_noise_mv(count_mv * ranges_of(world.level).adc_noise_counts)
        self._board = BoardOnStage(world, board=board, travel=travel)

    def take_output(self, now_s: float) -> bytes:
        self._board.run_until(now_s)
        return self._board.take_output()

    def give(self, data: bytes) -> None:
        self._board.give(data)


class Streamer:
    """A board that sends each scan unasked, at the speed of its line."""

    def __init__(
        self, world: World, *, baud: int, encode: Callable[[NDArray[np.int32]], bytes]
    ) -> None:
        self._world, self._byte_s, self._encode = world, _BITS / baud, encode
        self._scanned, self._line_free_s = 0, 0.0
        #: Times at which the last byte of each frame has left, and the frames.
        self._sending = deque[tuple[float, bytes]]()
        world.watchers.append(self._scan_until)

    def take_output(self, now_s: float) -> bytes:
        self._scan_until(now_s)
        sent = bytearray()
        while self._sending:
            end_s, frame = self._sending[0]
            left = max(math.ceil((end_s - now_s) / self._byte_s), 0)
            if left >= len(frame):
                break
            sent += frame[: len(frame) - left]
            self._sending.popleft()
            if left:
                self._sending.appendleft((end_s, frame[len(frame) - left :]))
                break
        return bytes(sent)

    def give(self, data: bytes) -> None:
        """Ignore the host, as these sketches do."""

    def _scan_until(self, time_s: float) -> None:
        while (due_s := (self._scanned + 1) / self._world.frame_rate_hz) <= time_s:
            self._scanned += 1
            frame = self._encode(self._world.scan(due_s))
            self._line_free_s = max(self._line_free_s, due_s) + len(frame) * self._byte_s
            self._sending.append((self._line_free_s, frame))


def encode_text(counts: NDArray[np.int32]) -> bytes:
    """Return a line of numbers, as `Serial.println` ends it."""
    return ",".join(map(str, counts.ravel().tolist())).encode() + b"\r\n"


def encode_flexitac(counts: NDArray[np.int32]) -> bytes:
    """Return a frame of FlexiTac's board."""
    return b"\xaa\x55" + counts.astype(np.uint8).tobytes()


class PortProbe:
    """Measures how late the kernel passes bytes through a terminal.

    It does so in a thread of the kernel, which waits for a processor like any program. What arrives
    late through no fault of the boards, the hands or the product, shows here.
    """

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._slave, False)
        self._sent_s: float | None = None
        self.latest_s = 0.0

    def look(self, now_s: float) -> None:
        """Send a byte, or look for the last one."""
        if self._sent_s is None:
            os.write(self._master, b"x")
            self._sent_s = now_s
        self.latest_s = max(self.latest_s, now_s - self._sent_s)
        with suppress(BlockingIOError):
            os.read(self._slave, 1)
            self._sent_s = None


class Adapter:
    """A USB serial adapter: a pseudo-terminal whose bytes from the board wait for its timer.

    While no program has the port open, the bytes of the board are lost. For a program that has
    opened the port and does not read, 64 KB are kept.

    `burst_s`: interval of the timer; 0 for none.
    """

    def __init__(self, board: BoardEnd, *, burst_s: float) -> None:
        self._board, self._burst_s, self._released = board, burst_s, 0
        self._held, self._waiting = bytearray(), bytearray()
        self.overflow_bytes = 0
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        # The device end sees a hang-up until a program opens the port.
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)

    def exchange(self, now_s: float) -> None:
        """Pass on the bytes of both directions."""
        self._held += self._board.take_output(now_s)
        events = dict(self._poll.poll(0)).get(self._master, 0)
        if events & select.POLLHUP:
            self._held.clear()
            self._waiting.clear()
            return
        if events & select.POLLIN:
            with suppress(OSError):
                self._board.give(os.read(self._master, _READ_BYTES))
        if not self._burst_s or int(now_s / self._burst_s) > self._released:
            self._released = int(now_s / self._burst_s) if self._burst_s else 0
            room = _KEPT_BYTES - len(self._waiting)
            self.overflow_bytes += max(len(self._held) - room, 0)
            self._waiting += self._held[:room]
            self._held.clear()
        while self._waiting:
            try:
                written = os.write(self._master, self._waiting[:_READ_BYTES])
            except BlockingIOError:
                break
            del self._waiting[:written]
