"""A pressure array on a serial port: frames in host time, with counted losses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import groupby
from operator import attrgetter

import numpy as np

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.sensor.array import ArrayLayout, Frame, LinkCounters
from palpate.sensor.board_link import BoardLink, minimum_delay_s
from palpate.sensor.byte_stream import ByteStream
from palpate.sensor.device_clock import DeviceClock
from palpate.sensor.frame_port import PortArray
from palpate.sensor.wire_messages import (
    BoardIdentity,
    BoardStatus,
    CellSample,
    Command,
    Contents,
    FrameMessage,
    Identify,
    Ping,
    SetCeiling,
    SetLayout,
    SetOversampling,
    SetRate,
    Start,
    Stop,
)

#: Interval of the heartbeats to a board whose outputs are used, well within the board's limit of
#: 0.5 s; and maximum age of a frame that counts as current.
HEARTBEAT_S, STALE_S = 0.1, 0.5
#: Pings are sent only if the last frame is not older than 3 periods plus the delay of an adapter.
_PING_PERIODS, _PING_S = 3, 0.02
#: Without a frame for this time the stream is set up again: 10 periods, at least 0.5 s.
_SILENT_PERIODS, _SILENT_S = 10, 0.5


class SerialArray(PortArray):
    """A `PressureArray` on a board with palpate's firmware.

    Parameters
    ----------
    stream : ByteStream
        An open port.
    clock : Clock
        The host's clock, used for the times of the frames.
    layout : ArrayLayout
        Matrix to scan; the board's full scale replaces `adc_bits`.
    rate_hz : float
        Requested frames per second.
    oversampling : int
        Conversions summed per pixel, 1 to 64.
    contents : Contents
        Data requested in addition to the pixels.
    reopen : callable, optional
        Opens the port again after a disconnection and raises `DeviceError` on failure. Without it,
        an unplugged board is permanently lost.

    Raises
    ------
    DeviceError
        If the board does not answer or refuses the setup. If the rate is too high, the message
        includes the highest possible rate.
    """

    def __init__(
        self,
        stream: ByteStream,
        *,
        clock: Clock,
        layout: ArrayLayout,
        rate_hz: float = 250.0,
        oversampling: int = 1,
        contents: Contents = Contents.PIXELS,
        reopen: Callable[[], ByteStream] | None = None,
    ) -> None:
        super().__init__(stream, clock=clock, layout=layout, reopen=reopen)
        self._rate_hz = rate_hz
        self._setup: tuple[Command, ...] = (
            Stop(),
            SetLayout(rows=layout.rows, cols=layout.cols),
            SetOversampling(conversions=oversampling),
            SetRate(rate_hz=rate_hz),
            Identify(),
            # Off and safe line high, until a rig arms the ceiling.
            SetCeiling(counts=0),
            Start(contents=contents),
        )
        self._link: BoardLink | None = BoardLink(stream, clock=clock)
        self._decoder = self._link.decoder
        self._device_clock = DeviceClock()
        self._newest: FrameMessage | None = None
        self._stream_number: int | None = None
        self._sequence_offset = 0
        self._last: Frame | None = None
        self._last_frame_s = clock.now_s()
        self._tripped = False
        try:
            frames = self._link.execute(*self._setup)
        except DeviceError:
            self.close()
            raise
        if self.identity is not None:
            bits = self.identity.full_scale.bit_length() - 1
            divider = replace(layout.divider, adc_bits=bits)
            self._layout = replace(layout, divider=divider)
        self._accept_frames(frames)
        self._start_reader()

    @property
    def identity(self) -> BoardIdentity | None:
        """The board's description of itself; None while the board is unplugged."""
        return None if self._link is None else self._link.identity

    @property
    def load_cells(self) -> tuple[CellSample, ...]:
        """Raw load-cell readings of the newest frame; empty unless requested."""
        return () if self._newest is None else self._newest.load_cells

    @property
    def newest_s(self) -> float:
        """Time of the newest frame and its `load_cells`; NaN before the first frame."""
        return math.nan if self._last is None else self._last.time_s

    @property
    def counters(self) -> LinkCounters:
        """Counters of the link."""
        return replace(
            self._decoder.counters,
            late=self._late,
            dropped=self._dropped,
            reconnects=self._reconnects,
            drift_ppm=self._device_clock.drift_ppm,
        )

    def read_newest(self) -> FrameMessage | None:
        """Return the newest frame as sent, with status and pressure; None before the first.

        The method receives waiting data without blocking. `read` still returns every frame.

        Raises
        ------
        DeviceError
            If the board is permanently lost.
        """
        with self._arrived:
            self._update()
            return self._newest

    def send(self, command: Command) -> None:
        """Send a command, e.g. a heartbeat or pressure, without waiting for its answer.

        A ping to a starting or silent board is skipped, because it would keep the board in its
        bootloader.

        Raises
        ------
        DeviceError
            If the board is unplugged.
        """
        with self._arrived:
            link = self._require_link()
            age_s = self._clock.now_s() - self._last_frame_s
            is_silent = age_s > _PING_PERIODS / self._rate_hz + _PING_S
            if not (isinstance(command, Ping) and (is_silent or link.is_busy)):
                link.send(command)

    def arm_ceiling(self, counts: int) -> None:
        """Set the pixel reading at which the board vents and lowers its safe line.

        The ceiling works without the host, and is set again after a reset of the board. After a
        trip, all frames report it until the next call, even after a reset of the board.

        Parameters
        ----------
        counts : int
            Counts per conversion, below the converter's full scale; 0 disables the ceiling.

        Raises
        ------
        DeviceError
            If the board is unplugged, refuses, or does not answer.
        """
        with self._arrived:
            link = self._require_link()
            ceiling, self._tripped = SetCeiling(counts=counts), False
            self._setup = (*self._setup[:-2], ceiling, self._setup[-1])
            self._accept_frames(link.execute(ceiling))

    def close(self) -> None:
        """Stop the stream and release the port; calling it again does nothing."""
        self._stop_reader()
        link, self._link = self._link, None
        try:
            if link is not None:
                link.send(Stop())
        except DeviceError:
            pass  # unplugged: there is nothing to stop
        finally:
            super().close()

    @property
    def _period_s(self) -> float:
        return 1 / self._rate_hz

    def _explain_silence(self, timeout_s: float) -> DeviceError:
        return DeviceTimeoutError(
            f"no frame from {self.name} in {timeout_s:.2f} s (expected every "
            f"{self._period_s:.3g} s). Check power, then run `palpate doctor`."
        )

    def _fetch(self) -> None:
        """Receive frames; reconnect after resets and disconnections."""
        now_s = self._clock.now_s()
        if self._link is None:
            if (stream := self._reopen_if_due()) is not None:
                self._link = BoardLink(stream, clock=self._clock, decoder=self._decoder)
                self._set_up(self._link)
                self._last_frame_s = now_s
            return
        try:
            frames = self._link.poll()
        except DeviceError as error:
            self._disconnect(error)
            self._link = None
            return
        if frames or self._link.is_busy:
            self._accept_frames(frames)
        is_silent = now_s - self._last_frame_s > max(_SILENT_S, _SILENT_PERIODS / self._rate_hz)
        if is_silent and not self._link.was_reset:
            self._link.wait_for_restart()
        if self._link.was_reset or is_silent:
            self._set_up(self._link)

    def _require_link(self) -> BoardLink:
        if self._link is None:
            raise DeviceError(f"{self.name} is unplugged; nothing can be sent to it")
        return self._link

    def _accept_frames(self, messages: list[FrameMessage]) -> None:
        """Queue frames that arrived together, except those sent before the layout was set."""
        self._last_frame_s = self._clock.now_s()
        shape = (self._layout.rows, self._layout.cols)
        fitting = [message for message in messages if message.counts.shape == shape]
        for _, burst in groupby(fitting, key=attrgetter("stream")):
            self._accept(list(burst), arrival_s=self._last_frame_s)

    def _set_up(self, link: BoardLink) -> None:
        """Set up the board again; after a trip omit the ceiling, which would clear it."""
        link.start_commands(
            [c for c in self._setup if not (self._tripped and isinstance(c, SetCeiling))]
        )

    def _accept(self, burst: list[FrameMessage], *, arrival_s: float) -> None:
        """Queue frames of one stream."""
        if burst[0].stream != self._stream_number:
            self._switch_stream(burst[0])
        times_s = self._device_clock.convert_burst(
            [message.time_us * 1e-6 for message in burst], arrival_s=arrival_s
        )
        for message, time_s in zip(burst, times_s, strict=True):
            self._tripped |= bool(message.status & BoardStatus.CEILING_TRIPPED)
            self._last = Frame(
                time_s=time_s,
                sequence=message.sequence + self._sequence_offset,
                counts=message.counts.astype(np.int32),
                oversampling=message.oversampling,
                ceiling_tripped=self._tripped,
            )
            self._queue(self._last, arrival_s=arrival_s)
        self._newest = burst[-1]

    def _switch_stream(self, message: FrameMessage) -> None:
        """Switch to a new stream: continue the frame numbers and restart the device clock."""
        self._stream_number = message.stream
        floor_s = 0.0
        if self.identity is not None:
            floor_s = minimum_delay_s(
                self.identity, pixels=self._layout.pixels, oversampling=message.oversampling
            )
        if self._last is None:
            self._device_clock = DeviceClock(floor_s=floor_s)
            return
        self._sequence_offset = self._last.sequence + 1
        self._device_clock = DeviceClock(floor_s=floor_s, not_before_s=self._last.time_s)
