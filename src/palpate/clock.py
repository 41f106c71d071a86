"""Clocks: a real one for hardware, a manual one for the twin and the tests."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Time for a loop: a monotonic reading and a way to wait."""

    def now_s(self) -> float:
        """Return monotonic time, seconds."""
        ...

    def sleep_s(self, duration_s: float) -> None:
        """Let `duration_s` pass."""
        ...


class RealClock:
    """The machine's monotonic clock."""

    def now_s(self) -> float:
        """Return `time.monotonic()`, seconds."""
        return time.monotonic()

    def sleep_s(self, duration_s: float) -> None:
        """Sleep for `duration_s` seconds (none if it is not positive)."""
        if duration_s > 0:
            time.sleep(duration_s)


class ManualClock:
    """A clock that moves only on command.

    >>> clock = ManualClock()
    >>> clock.sleep_s(0.25)
    >>> clock.now_s()
    0.25
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now_s(self) -> float:
        """Return the time it was moved to, seconds."""
        return self._now_s

    def sleep_s(self, duration_s: float) -> None:
        """Move time forward by `duration_s` seconds.

        Raises `ValueError` if `duration_s` is negative: time can't go backwards.
        """
        if duration_s < 0:
            raise ValueError(f"a clock can't go back by {-duration_s} s")
        self._now_s += duration_s
