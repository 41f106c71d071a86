"""Simulated frames paced by a real clock, at a chosen speed."""

from __future__ import annotations

import math
import time
from threading import Event

from palpate.sensor.array import ArrayLayout, Frame, PressureArray


class PacedArray:
    """An array that delays simulated frames according to the real clock.

    The delay does not affect the twin, whose clock has already advanced to the delayed frame.

    `speed`: seconds of simulated time per real second.

    >>> from palpate.twin.devices import TwinArray
    >>> from palpate.twin.world import World
    >>> array = PacedArray(TwinArray(World(None, seed=1)), speed=100.0)
    >>> array.read(timeout_s=1.0).sequence
    0
    """

    def __init__(self, array: PressureArray, *, speed: float) -> None:
        self._array, self._speed = array, speed
        self._anchor_s = math.nan
        self._skip = Event()

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._array.layout

    @property
    def speed(self) -> float:
        """Seconds of simulated time per real second."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self._speed, self._anchor_s = speed, math.nan

    def skip_wait(self) -> None:
        """Return the delayed frame at once, because of an urgent request."""
        self._skip.set()

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame once it is due in real time."""
        frame = self._array.read(timeout_s=timeout_s)
        # The anchor is the real time at which the simulated clock would have read 0.
        now_s = time.monotonic()
        wait_s = self._anchor_s + frame.time_s / self._speed - now_s
        if not -1.0 < wait_s < 1.0:  # the first frame, or after a suspend of the machine
            self._anchor_s, wait_s = now_s - frame.time_s / self._speed, 0.0
        if wait_s > 0 and self._skip.wait(wait_s):
            self._anchor_s = math.nan
        self._skip.clear()
        return frame

    def close(self) -> None:
        """Close the array."""
        self._array.close()
