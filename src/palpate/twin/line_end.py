"""The device end of a pseudo-terminal: the host opens a simulated device like a real port."""

from __future__ import annotations

import math
import os
import select
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from palpate.errors import DeviceNotFoundError


def open_terminal() -> tuple[int, int, str]:
    """Return both ends of a new pseudo-terminal and the name of the second.

    Raises `DeviceNotFoundError` if the system has none.
    """
    if sys.platform != "win32":
        with suppress(ImportError, AttributeError):
            import tty

            master, slave = os.openpty()
            tty.setraw(slave)
            return master, slave, os.ttyname(slave)
    raise DeviceNotFoundError(
        "this system has no pseudo-terminals, which a simulated device needs; use sim-rigid"
    )


class LineEnd:
    """The device end of a pseudo-terminal; the host opens the port `name`.

    `receive`: receives all waiting bytes, and returns the bytes of an incomplete packet. It runs on
        the thread of the line.
    """

    def __init__(self, receive: Callable[[bytes], bytes]) -> None:
        self._receive = receive
        self._delayed = list[tuple[float, bytes]]()
        self._master, self._slave, self.name = open_terminal()
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def send(self, data: bytes, *, late_s: float = 0.0) -> None:
        """Send bytes after a delay of `late_s` (real time), in order; `inf` discards them."""
        if late_s == math.inf:
            return
        if late_s or self._delayed:
            behind_s = self._delayed[-1][0] if self._delayed else 0.0
            self._delayed.append((max(time.monotonic() + late_s, behind_s), data))
        else:
            os.write(self._master, data)

    def unplug(self) -> None:
        """Remove the line; repeatable."""
        if not self._thread.is_alive():
            return
        os.write(self._waker, b"x")
        self._thread.join()
        for end in (self._master, self._slave, self._wake, self._waker):
            os.close(end)

    def _serve(self) -> None:
        waiting = b""
        while True:
            until_s = self._delayed[0][0] - time.monotonic() if self._delayed else None
            patience_s = None if until_s is None else max(until_s, 0.0)
            ready = select.select([self._master, self._wake], [], [], patience_s)[0]
            if self._wake in ready:
                return
            while self._delayed and self._delayed[0][0] <= time.monotonic():
                os.write(self._master, self._delayed.pop(0)[1])
            if self._master in ready:
                waiting = self._receive(waiting + os.read(self._master, 4096))
