"""The far end of a serial line: a pseudo-terminal with a thread that answers."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Callable


class LineEnd:
    """Bytes in, bytes out; its other end is the port `name`.

    Parameters
    ----------
    take : callable
        Gets the bytes that wait, and returns those that it can't use yet. Runs on a thread of its
        own.
    """

    def __init__(self, take: Callable[[bytes], bytes]) -> None:
        self._take = take
        self._held = list[tuple[float, bytes]]()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def send(self, data: bytes, *, late_s: float = 0.0) -> None:
        """Send bytes, now or so much later (real time)."""
        if late_s:
            self._held.append((time.monotonic() + late_s, data))
        else:
            os.write(self._master, data)

    def unplug(self) -> None:
        """Take the line away. Again does nothing."""
        if not self._thread.is_alive():
            return
        os.write(self._waker, b"x")
        self._thread.join()
        for end in (self._master, self._slave, self._wake, self._waker):
            os.close(end)

    def _serve(self) -> None:
        waiting = b""
        while True:
            until_s = self._held[0][0] - time.monotonic() if self._held else None
            ready = select.select(
                [self._master, self._wake], [], [], until_s and max(until_s, 0.0)
            )[0]
            if self._wake in ready:
                return
            while self._held and self._held[0][0] <= time.monotonic():
                os.write(self._master, self._held.pop(0)[1])
            if self._master in ready:
                waiting = self._take(waiting + os.read(self._master, 4096))
