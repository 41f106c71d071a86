"""Other makers' boards on a pseudo-terminal, in step with a manual clock.

Each reads a sheet that answers a load by a power law and creeps for some seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from tests.pty_port import PtyPort

from palpate.clock import ManualClock
from palpate.errors import DeviceNotFoundError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.one_way_array import FrameDecoder, OneWayArray
from palpate.signal.circuit import Divider, ohm_to_volts, volts_to_counts

PADS = ArrayLayout(name="4x2", rows=4, cols=2, finger_of_row=(0, 0, 1, 1))


FLEXITAC = ArrayLayout(
    name="flexitac-12x32",
    rows=12,
    cols=32,
    finger_of_row=(0,) * 12,
    divider=Divider(reference_ohm=1000.0, adc_bits=8),
)


class Sheet:
    """Pixels under a load that was laid on at some time."""

    def __init__(self, layout: ArrayLayout, *, rest_ohm: float = 12e3, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        shape = (layout.rows, layout.cols)
        self._rest_s = 1.0 / (rest_ohm * rng.uniform(0.8, 1.25, shape))
        self._share = rng.uniform(0.7, 1.3, shape) / layout.pixels
        self.load_n, self._since_s = 0.0, 0.0

    def lay(self, load_n: float, *, now_s: float) -> None:
        self.load_n, self._since_s = load_n, now_s

    def conductance_s(self, now_s: float) -> NDArray[np.float64]:
        creep = 1.0 - 0.2 * math.exp(-(now_s - self._since_s) / 3.0)
        excess = 8.0 * self.load_n**1.1 * creep * self._share
        return np.asarray(self._rest_s * (1.0 + excess))


class SendingBoard(PtyPort):
    """Sends a frame each period, whether somebody reads or not."""

    def __init__(
        self,
        clock: SendingClock,
        *,
        layout: ArrayLayout,
        encode: Callable[[NDArray[np.int32]], bytes],
        rate_hz: float = 100.0,
        rest_ohm: float = 12e3,
    ) -> None:
        super().__init__()
        self.clock, self.layout, self.encode = clock, layout, encode
        self.sheet = Sheet(layout, rest_ohm=rest_ohm)
        self.period_s = 1.0 / rate_hz
        self.sent = 0
        self.due_s = clock.now_s() + self.period_s
        self.silent = False
        #: Changes the bytes of one frame, by its number.
        self.spoil: Callable[[int, bytes], bytes] = lambda _, data: data
        #: Loads to lay on, by the number of the frame.
        self.loads_n: dict[int, float] = {}
        self._rng = np.random.default_rng(7)
        clock.boards.append(self)

    def counts(self, now_s: float) -> NDArray[np.int32]:
        conductance, divider = self.sheet.conductance_s(now_s), self.layout.divider
        noise = self._rng.normal(0.0, 0.4, conductance.shape)
        volts = ohm_to_volts(1.0 / conductance, divider=divider)
        return volts_to_counts(volts, divider=divider, noise_counts=noise)

    def advance(self, now_s: float) -> None:
        while self.due_s <= now_s:
            if self.sent in self.loads_n:
                self.sheet.lay(self.loads_n[self.sent], now_s=self.due_s)
            if self.plugged and not self.silent:
                self.send(self.spoil(self.sent, self.encode(self.counts(self.due_s))))
            self.sent += 1
            self.due_s += self.period_s

    def array(self, decoder: FrameDecoder) -> OneWayArray:
        return OneWayArray(
            self.open(), clock=self.clock, layout=self.layout, decoder=decoder, reopen=self.open
        )

    def open(self) -> SerialStream:
        if not self.plugged:
            raise DeviceNotFoundError("still unplugged")
        stream = SerialStream(self.port)
        self.clock.streams.append(stream)
        return stream


class SendingClock(ManualClock):
    """A manual clock for boards; in fast mode it skips time without transmission."""

    def __init__(self, start_s: float = 100.0, *, in_a_hurry: bool = False) -> None:
        super().__init__(start_s)
        self.in_a_hurry = in_a_hurry
        self.boards: list[SendingBoard] = []
        self.streams: list[SerialStream] = []

    def sleep_s(self, duration_s: float) -> None:
        if self.in_a_hurry:
            due_s = min(board.due_s for board in self.boards)
            duration_s = max(duration_s, due_s - self.now_s())
        super().sleep_s(duration_s)
        for board in self.boards:
            board.advance(self.now_s())

    def close(self) -> None:
        for stream in self.streams:
            stream.close()
        for board in self.boards:
            if board.plugged:
                board.unplug()


def line_of(counts: NDArray[np.int32]) -> bytes:
    """Return a frame as a line of all its counts."""
    return (",".join(map(str, counts.ravel().tolist())) + "\r\n").encode()


def block_of(counts: NDArray[np.int32]) -> bytes:
    """Return a frame as a line a row and a blank line."""
    return "".join("\t".join(map(str, row)) + "\t\n" for row in counts.tolist()).encode() + b"\n"


def ohm_line_of(divider: Divider) -> Callable[[NDArray[np.int32]], bytes]:
    """Return what prints resistances after a time in ms."""

    def encode(counts: NDArray[np.int32]) -> bytes:
        ohm = divider.reference_ohm * (divider.full_scale / counts.ravel() - 1.0)
        return ("12345; " + "; ".join(f"{value:.1f}" for value in ohm) + "\n").encode()

    return encode


def marked(counts: NDArray[np.int32]) -> bytes:
    """Return a frame as FlexiTac's program sends it."""
    return b"\xaa\x55" + counts.astype(np.uint8).tobytes()


def heard_at(data: bytes, *, sent_baud: int, read_baud: int) -> bytes:
    """Return the bytes received at another port speed: start bit, eight bits, stop bit."""
    bits = [bit for byte in data for bit in (0, *((byte >> k) & 1 for k in range(8)), 1)] + [1] * 20
    heard, at = bytearray(), 0.0
    step = sent_baud / read_baud
    while int(at + 10 * step) < len(bits):
        if bits[int(at)]:
            at += min(step, 1.0) / 8
            continue
        middle = [bits[int(at + (k + 0.5) * step)] for k in range(1, 9)]
        heard.append(sum(bit << k for k, bit in enumerate(middle)))
        at += 9.5 * step
    return bytes(heard)
