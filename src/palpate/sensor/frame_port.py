"""A pressure array on a serial port, which it reopens after an unplug."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.byte_stream import ByteStream

#: Bytes are fetched in bulk this often: a quarter of the time between frames at 500 Hz at most.
_POLL_S = 0.001
#: Between two attempts to open a port that was pulled out.
_REOPEN_S = 0.25
#: Frames older than this when they are read count as late: 5 periods, at least 100 ms.
_LATE_PERIODS, _LATE_S = 5, 0.1


class PortArray(ABC):
    """A `PressureArray` on a port; a kind of board fetches its frames.

    `reopen`: opens the port again after an unplug, raising `DeviceError` while it can't; without
    it, an unplugged board is lost for good.
    """

    def __init__(
        self,
        stream: ByteStream,
        *,
        clock: Clock,
        layout: ArrayLayout,
        reopen: Callable[[], ByteStream] | None,
    ) -> None:
        #: The present or last port of the board.
        self.name = stream.name
        self._layout, self._clock, self._reopen = layout, clock, reopen
        #: None while the board is unplugged.
        self._stream: ByteStream | None = stream
        #: Frames that came and were not read yet.
        self._waiting: deque[Frame] = deque()
        self._late = self._reconnects = 0
        self._tried_s = clock.now_s()

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._layout

    @property
    @abstractmethod
    def _period_s(self) -> float:
        """Time between frames; 0 before it is known."""

    @abstractmethod
    def _fetch(self) -> None:
        """Receive frames into `_waiting`; reconnect after an unplug."""

    @abstractmethod
    def _explain_silence(self, timeout_s: float) -> DeviceError:
        """Return why there may be no frame from a board whose port is open."""

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame, oldest first.

        Raises
        ------
        DeviceTimeoutError
            If none came within `timeout_s`; an unplugged board is waited for, so call again.
        WireError
            If only bytes came that are no frames.
        DeviceError
            If the board is gone for good.
        """
        deadline_s = self._clock.now_s() + timeout_s
        while not self._waiting:
            self._fetch()
            if self._waiting:
                break
            left_s = deadline_s - self._clock.now_s()
            if left_s > 0:
                self._clock.sleep_s(min(_POLL_S, left_s))
            elif self._stream is not None:
                raise self._explain_silence(timeout_s)
            else:
                raise DeviceTimeoutError(
                    f"{self.name} is unplugged ({timeout_s:g} s without a frame). Plug it in again."
                )
        frame = self._waiting.popleft()
        age_s = self._clock.now_s() - frame.time_s
        self._late += age_s > max(_LATE_S, _LATE_PERIODS * self._period_s)
        return frame

    def close(self) -> None:
        """Release the port; calling it again does nothing."""
        self._reopen = None
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _disconnect(self, error: DeviceError) -> None:
        """Close the port after its board was unplugged; raise `error` if it can't be reopened."""
        if self._reopen is None:
            raise error
        if self._stream is not None:
            self._stream.close()
        self._stream, self._tried_s = None, self._clock.now_s()

    def _reopen_if_due(self) -> ByteStream | None:
        """Return the port if an attempt was due and it could be opened.

        Raises `DeviceNotFoundError` if it was closed.
        """
        if self._reopen is None:
            raise DeviceNotFoundError(f"{self.name} was closed")
        now_s = self._clock.now_s()
        if now_s - self._tried_s < _REOPEN_S:
            return None
        self._tried_s = now_s
        try:
            self._stream = self._reopen()
        except DeviceError:
            return None  # still unplugged: the timeout informs the caller
        self.name = self._stream.name
        self._reconnects += 1
        return self._stream
