"""Clocks: a real one for hardware, a manual one for the twin and the tests."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock with a wait."""

    def now_s(self) -> float:
        """Return monotonic time, seconds."""
        ...

    def sleep_s(self, duration_s: float) -> None:
        """Wait for `duration_s` seconds."""
        ...


class RealClock:
    """The machine's monotonic clock."""

    def now_s(self) -> float:
        """Return `time.monotonic()`, seconds."""
        return time.monotonic()

    def sleep_s(self, duration_s: float) -> None:
        """Sleep for `duration_s` seconds, if positive."""
        if duration_s > 0:
            time.sleep(duration_s)


class ManualClock:
    """A clock that advances only in `sleep_s`.

    >>> clock = ManualClock()
    >>> clock.sleep_s(0.25)
    >>> clock.now_s()
    0.25
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now_s(self) -> float:
        """Return the current time, seconds."""
        return self._now_s

    def sleep_s(self, duration_s: float) -> None:
        """Advance the time by `duration_s` seconds.

        Raises `ValueError` if `duration_s` is negative.
        """
        if duration_s < 0:
            raise ValueError(f"a clock can't go back by {-duration_s} s")
        self._now_s += duration_s
