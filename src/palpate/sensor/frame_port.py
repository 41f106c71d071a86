"""A pressure array on a serial port, reopened after a disconnection."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.byte_stream import POLL_S, ByteStream

#: Interval between attempts to open the port of an unplugged board.
_REOPEN_S = 0.25
#: A frame older than this when it is read counts as late: 5 periods, at least 100 ms.
_LATE_PERIODS, _LATE_S = 5, 0.1


class PortArray(ABC):
    """A `PressureArray` on a port; a subclass for each kind of board fetches the frames.

    `reopen`: opens the port again after a disconnection and raises `DeviceError` on failure.
        Without `reopen`, an unplugged board is permanently lost.
    """

    def __init__(
        self,
        stream: ByteStream,
        *,
        clock: Clock,
        layout: ArrayLayout,
        reopen: Callable[[], ByteStream] | None,
    ) -> None:
        #: The current or last port of the board.
        self.name = stream.name
        self._layout, self._clock, self._reopen = layout, clock, reopen
        #: None while the board is unplugged.
        self._stream: ByteStream | None = stream
        #: Received frames not yet read.
        self._waiting: deque[Frame] = deque()
        self._late = self._reconnects = 0
        self._last_attempt_s = clock.now_s()

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._layout

    @property
    @abstractmethod
    def _period_s(self) -> float:
        """Time between frames; 0 while unknown."""

    @abstractmethod
    def _fetch(self) -> None:
        """Receive frames into `_waiting`; reconnect after a disconnection."""

    @abstractmethod
    def _explain_silence(self, timeout_s: float) -> DeviceError:
        """Return the error for a board that sends no frames on an open port."""

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame, oldest first.

        Raises
        ------
        DeviceTimeoutError
            If no frame arrived within `timeout_s`. Later calls can succeed, even after a
            disconnection.
        WireError
            If bytes arrived but no valid frame.
        DeviceError
            If the board is permanently lost.
        """
        deadline_s = self._clock.now_s() + timeout_s
        while not self._waiting:
            self._fetch()
            if self._waiting:
                break
            remaining_s = deadline_s - self._clock.now_s()
            if remaining_s > 0:
                self._clock.sleep_s(min(POLL_S, remaining_s))
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
        """Close the port after a disconnection; raise `error` if there is no `reopen`."""
        if self._reopen is None:
            raise error
        if self._stream is not None:
            self._stream.close()
        self._stream, self._last_attempt_s = None, self._clock.now_s()

    def _reopen_if_due(self) -> ByteStream | None:
        """Reopen the port if an attempt is due; return the port, or None.

        Raises `DeviceNotFoundError` if the array was closed.
        """
        if self._reopen is None:
            raise DeviceNotFoundError(f"{self.name} was closed")
        now_s = self._clock.now_s()
        if now_s - self._last_attempt_s < _REOPEN_S:
            return None
        self._last_attempt_s = now_s
        try:
            self._stream = self._reopen()
        except DeviceError:
            return None  # still unplugged: the caller gets a timeout from `read`
        self.name = self._stream.name
        self._reconnects += 1
        return self._stream
