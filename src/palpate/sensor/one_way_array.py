"""A pressure array on a board that sends readings without frame numbers, times or checksums.

The array counts the frames that its decoder rejects, and infers missing frames from gaps in time.
A changed digit or byte is not detected.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, DeviceTimeoutError, InputError, WireError
from palpate.sensor.array import ArrayLayout, Frame, LinkCounters
from palpate.sensor.byte_stream import ByteStream, SerialStream
from palpate.sensor.frame_port import PortArray
from palpate.sensor.ports import make_port_finder

Counts: TypeAlias = NDArray[np.int32]

#: Opening the port resets most boards: up to 2 s for the bootloader, then the program's start.
OPEN_S = 5.0
_LONGEST_WAIT_S = 600.0
#: Number of frames in the running mean of the period, and minimum number for a period.
_PERIOD_FRAMES, _MIN_FRAMES = 1000, 8
#: A gap longer than one period by this many periods may contain lost frames (guess: up to half a
#: period is jitter).
_GAP_PERIODS = 0.75
#: Frames in a gap count as lost after several regular periods, each within this tolerance (guesses:
#: a busy computer delays frames several times in a row).
_IRREGULAR_PERIODS, _SETTLED_PERIODS = 0.25, 8
#: Without another frame for this many periods, or seconds, the bytes that arrive have another form.
_SILENT_PERIODS, _SILENT_S = 10, 1.0
_NO_END = "no end of a frame found; check the baud rate and the layout in the rig file"


class FrameDecoder(Protocol):
    """Finds frames in the bytes from one kind of board."""

    @property
    def corrupt(self) -> int:
        """Number of rejected lines or frames."""
        ...

    @property
    def fault(self) -> str:
        """Fault of the last rejected line or frame, with the remedy; empty if none."""
        ...

    def feed(self, data: bytes) -> list[Counts]:
        """Append bytes and return the completed frames, shape (rows, cols) each."""
        ...


class OneWayArray(PortArray):
    """A `PressureArray` on a board that sends frames without a request.

    The array numbers the frames, and skips the numbers of frames that were lost in a gap in time.
    The time of a frame is its arrival time. The times of frames that arrive together are spread
    over the time before their arrival.

    Parameters
    ----------
    stream : ByteStream
        An open port.
    clock : Clock
        The host's clock; frames carry its time.
    layout : ArrayLayout
        Layout of the decoder's frames.
    decoder : FrameDecoder
        Finds the frames.
    reopen : callable, optional
        Opens the port again after a disconnection and raises `DeviceError` on failure. Without it,
        an unplugged board is permanently lost.
    wait_s : float
        Longest time until the first frame.

    Raises
    ------
    DeviceError
        If no frame arrives within `wait_s`.
    """

    def __init__(
        self,
        stream: ByteStream,
        *,
        clock: Clock,
        layout: ArrayLayout,
        decoder: FrameDecoder,
        reopen: Callable[[], ByteStream] | None = None,
        wait_s: float = OPEN_S,
    ) -> None:
        super().__init__(stream, clock=clock, layout=layout, reopen=reopen)
        self._decoder = decoder
        self._timing = _FrameTiming()
        self._last_s = clock.now_s()
        self._bytes = 0
        self._next = self._frames = self._lost = 0
        try:
            self._waiting.appendleft(self.read(timeout_s=wait_s))
        except DeviceError:
            self.close()
            raise
        self._start_reader()

    @classmethod
    def open_port(
        cls,
        port: str,
        *,
        baud: int,
        layout: ArrayLayout,
        decoder: FrameDecoder,
        wait_s: float = OPEN_S,
    ) -> OneWayArray:
        """Open the array of a serial board; the array reconnects after a disconnection.

        Raises `InputError` if `wait_s` is invalid; `DeviceError` if the port can't be opened, or
        no frame arrives.
        """
        if not 0 < wait_s <= _LONGEST_WAIT_S:
            raise InputError(
                f"wait_s = {wait_s:g}: give more than 0 and at most {_LONGEST_WAIT_S:g} s"
            )
        find_current_port = make_port_finder(port)
        return cls(
            SerialStream(port, baud=baud),
            clock=RealClock(),
            layout=layout,
            decoder=decoder,
            reopen=lambda: SerialStream(find_current_port(), baud=baud),
            wait_s=wait_s,
        )

    @property
    def counters(self) -> LinkCounters:
        """Counters of the link; losses are inferred from gaps in time."""
        return LinkCounters(
            frames=self._frames,
            lost=self._lost,
            corrupt=self._decoder.corrupt,
            late=self._late,
            dropped=self._dropped,
            reconnects=self._reconnects,
        )

    @property
    def _period_s(self) -> float:
        return self._timing.period_s or 0.0

    def _fetch(self) -> None:
        now_s = self._clock.now_s()
        if self._stream is None:
            if self._reopen_if_due() is not None:
                self._timing, self._last_s = _FrameTiming(), now_s
                # Without it, the halves of two lines could form a valid line.
                getattr(self._decoder, "restart", lambda: None)()
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
        """Assign numbers and times to frames that arrived together."""
        elapsed_s, count = arrival_s - self._last_s, len(counts)
        missing = self._timing.add_arrival(elapsed_s, frames=count) if self._frames else 0
        self._lost += missing
        self._next += missing
        step_s = min(elapsed_s / count, self._timing.period_s or elapsed_s)
        for index, frame_counts in enumerate(counts):
            # Time increases even between two reads within the clock's resolution.
            time_s = arrival_s - (count - 1 - index) * step_s
            self._last_s = max(time_s, self._last_s + 1e-6)
            # Only a decoder of mean counts has this attribute.
            frame = Frame(
                time_s=self._last_s,
                sequence=self._next,
                counts=frame_counts,
                oversampling=getattr(self._decoder, "oversampling", 1),
            )
            self._queue(frame, arrival_s=arrival_s)
            self._next += 1
        self._frames += count

    def _explain_silence(self, timeout_s: float) -> DeviceError:
        # A caller that waits for less than a period finds the begin of the next frame.
        silent_s = self._clock.now_s() - self._last_s
        is_overdue = silent_s > max(_SILENT_PERIODS * self._period_s, _SILENT_S)
        if self._bytes and (is_overdue or not self._frames):
            rows, cols = self._layout.rows, self._layout.cols
            return WireError(
                f"{self.name}: {self._bytes} bytes but no frame of {rows} x {cols} readings in "
                f"{timeout_s:g} s: {self._decoder.fault or _NO_END}"
            )
        return DeviceTimeoutError(
            f"{self.name}: no data in {timeout_s:g} s. Check the board's power, and that its "
            "firmware streams readings without being polled. If it starts slowly, set wait_s in "
            "the rig file."
        )


class _FrameTiming:
    """Estimates the frame period and the number of missing frames."""

    def __init__(self) -> None:
        #: None while unknown.
        self.period_s: float | None = None
        self._elapsed_s = self._frames = 0.0
        #: Periods of the present gap without a frame, and duration of regular arrivals after it.
        self._gap = self._regular_s = 0.0

    def add_arrival(self, elapsed_s: float, *, frames: int) -> int:
        """Add frames that arrived `elapsed_s` after the last; return the number of lost frames.

        Frames in a gap are lost only if the later frames arrive regularly. Frames that were only
        delayed arrive together and fill the gap.
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
        weight = 1.0 - min(frames / _PERIOD_FRAMES, 1.0)
        self._elapsed_s = weight * self._elapsed_s + elapsed_s
        self._frames = weight * self._frames + frames
        if self._frames >= _MIN_FRAMES:
            self.period_s = self._elapsed_s / self._frames
        return missing
