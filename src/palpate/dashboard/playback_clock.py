"""Where a replay is and how fast it goes: set by the page at any time, read by the loop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class PlaybackClock:
    """A clock that can be paused, moved and sped up; safe to use from two threads.

    Parameters
    ----------
    start_s, end_s : float
        Of the recording; the clock stays between them.
    speed : float
        Seconds of the recording in a second on the wall.
    now_s : callable
        The wall's time.

    Examples
    --------
    >>> wall_s = [0.0]
    >>> clock = PlaybackClock(start_s=10.0, end_s=20.0, speed=2.0, now_s=lambda: wall_s[0])
    >>> wall_s[0] = 3.0
    >>> clock.at_s
    16.0
    >>> clock.pause(True); clock.seek(12.0)
    >>> wall_s[0] = 9.0
    >>> clock.at_s
    12.0
    """

    def __init__(
        self,
        *,
        start_s: float,
        end_s: float,
        speed: float,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._start_s, self._end_s, self._now_s = start_s, end_s, now_s
        self._speed, self._paused = speed, False
        self._anchor_s, self._wall_s = start_s, now_s()
        self._lock = threading.Lock()

    @property
    def at_s(self) -> float:
        """The recording's time now."""
        with self._lock:
            return self._at_s()

    @property
    def speed(self) -> float:
        """Seconds of the recording in a second."""
        return self._speed

    @property
    def paused(self) -> bool:
        """Whether it is paused."""
        return self._paused

    def seek(self, time_s: float) -> None:
        """Go on from this time of the recording."""
        with self._lock:
            self._anchor_s, self._wall_s = self._within(time_s), self._now_s()

    def pause(self, paused: bool) -> None:
        """Pause, or go on; from the end it restarts."""
        with self._lock:
            at_s = self._at_s()
            again = self._paused and not paused and at_s >= self._end_s
            self._anchor_s, self._wall_s = self._start_s if again else at_s, self._now_s()
            self._paused = paused

    def set_speed(self, speed: float) -> None:
        """Set the speed from now on."""
        with self._lock:
            self._anchor_s, self._wall_s = self._at_s(), self._now_s()
            self._speed = speed

    def _at_s(self) -> float:
        passed_s = 0.0 if self._paused else self._speed * (self._now_s() - self._wall_s)
        return self._within(self._anchor_s + passed_s)

    def _within(self, time_s: float) -> float:
        return min(max(time_s, self._start_s), self._end_s)
