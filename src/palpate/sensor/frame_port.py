"""A pressure array on a serial port: one reader, a queue of frames, reopened after a disconnection.

With a real clock, a thread receives the frames as they arrive. A program that is busy, or waits for
its user, thus finds frames with the right times, and a port that never fills up. With any other
clock, the program's own calls receive them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from threading import Condition, Event, Thread, current_thread

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.byte_stream import POLL_S, ByteStream, wait_for_bytes

#: Interval between attempts to open the port of an unplugged board.
_REOPEN_S = 0.25
#: A frame older than this on arrival counts as late: 5 periods, at least 100 ms.
_LATE_PERIODS, _LATE_S = 5, 0.1
#: Longest wait of the reader for bytes; a command to the board is repeated after such a wait.
_WAIT_S = 0.02
#: Size of the queue: 20 s at 250 frames/s. The oldest frames are removed from a full queue.
MAX_WAITING = 5000


class PortArray(ABC):
    """A `PressureArray` on a port; a subclass for each kind of board fetches the frames.

    A subclass calls `_start_reader` at the end of its constructor.

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
        self._late = self._reconnects = self._dropped = 0
        self._last_attempt_s = clock.now_s()
        #: Guards all of the above, and is notified of new frames.
        self._arrived = Condition()
        self._closing = Event()
        #: None before the start, and without a real clock.
        self._reader: Thread | None = None
        #: The error that ended the reader.
        self._failure: DeviceError | None = None

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
        """Receive frames and queue them; reconnect after a disconnection."""

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
        with self._arrived:
            while not self._waiting:
                self._update()
                if self._waiting:
                    break
                remaining_s = deadline_s - self._clock.now_s()
                if remaining_s > 0:
                    self._wait(remaining_s)
                elif self._stream is not None:
                    raise self._explain_silence(timeout_s)
                else:
                    raise DeviceTimeoutError(
                        f"{self.name} is unplugged ({timeout_s:g} s without a frame). "
                        "Plug it in again."
                    )
            return self._waiting.popleft()

    def close(self) -> None:
        """Release the port; calling it again does nothing."""
        self._stop_reader()
        self._reopen = None
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _start_reader(self) -> None:
        """Receive frames in a thread from now on, if the clock is real."""
        if isinstance(self._clock, RealClock):
            self._reader = Thread(target=self._run_reader, name="palpate-port", daemon=True)
            self._reader.start()

    def _stop_reader(self) -> None:
        self._closing.set()
        if self._reader is not None and self._reader is not current_thread():
            self._reader.join()

    def _run_reader(self) -> None:
        while not self._closing.is_set():
            with self._arrived:
                try:
                    self._fetch()
                except DeviceError as error:
                    self._failure = error
                self._arrived.notify_all()
                stream = self._stream
            if self._failure is not None:
                return
            if stream is None:
                self._closing.wait(_WAIT_S)
            else:
                wait_for_bytes(stream, timeout_s=_WAIT_S)

    def _update(self) -> None:
        """Receive frames without a thread; raise the error that ended the thread."""
        if self._failure is not None:
            raise self._failure
        if self._reader is None:
            self._fetch()

    def _wait(self, remaining_s: float) -> None:
        """Wait for frames, with the lock released if a thread receives them."""
        if self._reader is None:
            self._clock.sleep_s(min(POLL_S, remaining_s))
        else:
            self._arrived.wait(min(remaining_s, _WAIT_S))

    def _queue(self, frame: Frame, *, arrival_s: float) -> None:
        """Add a frame to the queue."""
        if len(self._waiting) == MAX_WAITING:
            self._waiting.popleft()
            self._dropped += 1
        self._waiting.append(frame)
        self._late += arrival_s - frame.time_s > max(_LATE_S, _LATE_PERIODS * self._period_s)

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
