"""A pressure array on a board that sends bare readings: no numbers, times or checksums.

What can be detected is counted: frames that do not parse by their decoder, frames that are missing
by the time between their neighbours. A changed digit or byte is not detected.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, DeviceTimeoutError, WireError
from palpate.sensor.array import ArrayLayout, Frame, LinkCounters
from palpate.sensor.byte_stream import ByteStream, SerialStream
from palpate.sensor.frame_port import PortArray
from palpate.sensor.ports import follow_port

Counts: TypeAlias = NDArray[np.int32]

#: Opening its port resets most boards: boot loader up to 2 s, and the program's own start.
OPEN_S = 5.0
#: Frames that the period is averaged over (a running mean), and fewest to know it.
_PERIOD_FRAMES, _FEWEST_FRAMES = 1000, 8
#: A gap by this many periods more than a frame takes hides lost ones (guess: a half is jitter).
_GAP_PERIODS = 0.75
#: A gap counts once frames have come regularly for some periods, none of them early or late by more
#: than this (guesses: a busy computer delays in several pieces).
_IRREGULAR_PERIODS, _SETTLED_PERIODS = 0.25, 8
_NO_END = "none has an end; the baud rate is another (baud in the rig file), or the layout"


class FrameDecoder(Protocol):
    """Finds frames in the bytes of one kind of board."""

    @property
    def corrupt(self) -> int:
        """Number of rejected lines or frames."""
        ...

    @property
    def fault(self) -> str:
        """Fault of the last rejected one, with the remedy; empty before one."""
        ...

    def feed(self, data: bytes) -> list[Counts]:
        """Take bytes; return the frames that they complete, shape (rows, cols) each."""
        ...


class OneWayArray(PortArray):
    """A `PressureArray` on a board that sends frames without being asked.

    Frames are numbered here: after a gap in time the number rises by the frames that are missing.
    They carry the time of their arrival; those that arrive together are spread over the time
    before.

    Parameters
    ----------
    stream : ByteStream
        An open port.
    clock : Clock
        The host's clock; frames carry its time.
    layout : ArrayLayout
        Layout of the frames that the decoder gives.
    decoder : FrameDecoder
        Finds the frames.
    reopen : callable, optional
        Opens the port again after an unplug, raising `DeviceError` while it can't. Without it, an
        unplugged board is lost for good.

    Raises
    ------
    DeviceError
        If no frame comes within 5 s.
    """

    def __init__(
        self,
        stream: ByteStream,
        *,
        clock: Clock,
        layout: ArrayLayout,
        decoder: FrameDecoder,
        reopen: Callable[[], ByteStream] | None = None,
    ) -> None:
        super().__init__(stream, clock=clock, layout=layout, reopen=reopen)
        self._decoder = decoder
        self._timing = _Timing()
        self._last_s = clock.now_s()
        self._bytes = 0
        self._next = self._frames = self._lost = 0
        try:
            self._waiting.appendleft(self.read(timeout_s=OPEN_S))
        except DeviceError:
            self.close()
            raise

    @classmethod
    def on_port(
        cls, port: str, *, baud: int, layout: ArrayLayout, decoder: FrameDecoder
    ) -> OneWayArray:
        """Return the array of a serial board; it reconnects after an unplug.

        Raises `DeviceError` if the port can't be opened, or no frame comes.
        """
        where = follow_port(port)
        return cls(
            SerialStream(port, baud=baud),
            clock=RealClock(),
            layout=layout,
            decoder=decoder,
            reopen=lambda: SerialStream(where(), baud=baud),
        )

    @property
    def counters(self) -> LinkCounters:
        """Counters of the link; losses are inferred from gaps in time."""
        return LinkCounters(
            frames=self._frames,
            lost=self._lost,
            corrupt=self._decoder.corrupt,
            late=self._late,
            reconnects=self._reconnects,
        )

    @property
    def _period_s(self) -> float:
        return self._timing.period_s or 0.0

    def _fetch(self) -> None:
        now_s = self._clock.now_s()
        if self._stream is None:
            if self._reopen_if_due() is not None:
                self._timing, self._last_s = _Timing(), now_s
            return
        try:
            data = self._stream.read_waiting()
        except DeviceError as error:
            self._disconnect(error)
            return
        self._bytes += len(data)
        if data and (counts := self._decoder.feed(data)):
            self._bytes = 0
            self._accept(counts, arrival_s=now_s)

    def _accept(self, counts: list[Counts], *, arrival_s: float) -> None:
        """Number and date frames that arrived together."""
        elapsed_s, count = arrival_s - self._last_s, len(counts)
        missing = self._timing.add(elapsed_s, frames=count) if self._frames else 0
        self._lost += missing
        self._next += missing
        step_s = min(elapsed_s / count, self._timing.period_s or elapsed_s)
        for index, one in enumerate(counts):
            # Two reads within the clock's resolution: time still rises.
            time_s = arrival_s - (count - 1 - index) * step_s
            self._last_s = max(time_s, self._last_s + 1e-6)
            self._waiting.append(Frame(time_s=self._last_s, sequence=self._next, counts=one))
            self._next += 1
        self._frames += count

    def _explain_silence(self, timeout_s: float) -> DeviceError:
        if self._bytes:
            rows, cols = self._layout.rows, self._layout.cols
            return WireError(
                f"{self.name}: {self._bytes} bytes and no frame of {rows} x {cols} readings in "
                f"{timeout_s:g} s: {self._decoder.fault or _NO_END}"
            )
        return DeviceTimeoutError(
            f"{self.name}: nothing came in {timeout_s:g} s. Check its power, and that its "
            "firmware sends readings unprompted."
        )


class _Timing:
    """The period of frames, and the number missing between received ones."""

    def __init__(self) -> None:
        #: None before it is known.
        self.period_s: float | None = None
        self._elapsed_s = self._frames = 0.0
        #: Periods without a frame that later ones may still make up for, and since when none has.
        self._gap = self._regular_s = 0.0

    def add(self, elapsed_s: float, *, frames: int) -> int:
        """Add the time since the last frame, and the frames received then.

        Returns the frames that a gap hid, once those after it have come in time: frames that were
        only delayed come together.
        """
        missing = 0
        if self.period_s is not None:
            periods = elapsed_s / self.period_s - frames
            if self._gap or periods >= _GAP_PERIODS:
                self._gap += periods
                self._regular_s = (
                    0.0 if abs(periods) > _IRREGULAR_PERIODS else self._regular_s + elapsed_s
                )
            if self._gap and self._regular_s >= _SETTLED_PERIODS * self.period_s:
                missing, self._gap = max(round(self._gap), 0), 0.0
        kept = 1.0 - min(frames / _PERIOD_FRAMES, 1.0)
        self._elapsed_s = kept * self._elapsed_s + elapsed_s
        self._frames = kept * self._frames + frames
        if self._frames >= _FEWEST_FRAMES:
            self.period_s = self._elapsed_s / self._frames
        return missing
