"""The port of a board's frames, reopened after an unplug."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError
from palpate.sensor.array import Frame
from palpate.sensor.byte_stream import ByteStream

#: Bytes are fetched in bulk this often: a quarter of the time between frames at 500 Hz at most.
_POLL_S = 0.001
#: Between two attempts to open a port that was pulled out.
_REOPEN_S = 0.25
#: Frames older than this when they are read count as late: 5 periods, at least 100 ms.
_LATE_PERIODS, _LATE_S = 5, 0.1


class FramePort:
    """A port, and its frames that have not been read yet.

    `reopen`: opens the port again after an unplug, raising `DeviceError` while it can't; without
    it, an unplugged board is lost for good.
    """

    def __init__(
        self, stream: ByteStream, *, clock: Clock, reopen: Callable[[], ByteStream] | None
    ) -> None:
        #: None while the board is unplugged.
        self.stream: ByteStream | None = stream
        #: The port that it is, or was last, at.
        self.name = stream.name
        self.waiting: deque[Frame] = deque()
        self.late = self.reconnects = 0
        self._clock, self._reopen = clock, reopen
        self._tried_s = clock.now_s()

    def read(
        self,
        fetch: Callable[[], None],
        *,
        timeout_s: float,
        period_s: float,
        silence: Callable[[], DeviceError],
    ) -> Frame:
        """Return the next frame, oldest first; `fetch` adds received ones to `waiting`.

        Raises what `silence` returns if none came in time, `DeviceTimeoutError` while unplugged.
        """
        deadline_s = self._clock.now_s() + timeout_s
        while not self.waiting:
            fetch()
            if self.waiting:
                break
            left_s = deadline_s - self._clock.now_s()
            if left_s > 0:
                self._clock.sleep_s(min(_POLL_S, left_s))
            elif self.stream is not None:
                raise silence()
            else:
                raise DeviceTimeoutError(
                    f"{self.name} is unplugged ({timeout_s:g} s without a frame). Plug it in again."
                )
        frame = self.waiting.popleft()
        age_s = self._clock.now_s() - frame.time_s
        self.late += age_s > max(_LATE_S, _LATE_PERIODS * period_s)
        return frame

    def disconnect(self, error: DeviceError) -> None:
        """Close the port after its board was unplugged; raise `error` if it can't be reopened."""
        if self._reopen is None:
            raise error
        if self.stream is not None:
            self.stream.close()
        self.stream, self._tried_s = None, self._clock.now_s()

    def reopen_if_due(self) -> ByteStream | None:
        """Reopen the port if an attempt is due; return it if that worked.

        Raises `DeviceNotFoundError` if it was closed.
        """
        if self._reopen is None:
            raise DeviceNotFoundError(f"{self.name} was closed")
        now_s = self._clock.now_s()
        if now_s - self._tried_s < _REOPEN_S:
            return None
        self._tried_s = now_s
        try:
            self.stream = self._reopen()
        except DeviceError:
            return None  # still unplugged: the timeout informs the caller
        self.name = self.stream.name
        self.reconnects += 1
        return self.stream

    def close(self) -> None:
        """Release the port; calling it again does nothing."""
        self._reopen = None
        if self.stream is not None:
            self.stream.close()
            self.stream = None
