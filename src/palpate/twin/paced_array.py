"""Simulated time at the pace of a real clock, or a multiple of it."""

from __future__ import annotations

import math
import time
from threading import Event

from palpate.sensor.array import ArrayLayout, Frame, PressureArray


class PacedArray:
    """An array on simulated time whose frames wait for the real clock.

    The twin is independent of it: its clock has moved to the frame already, and no call asks it for
    more until the frame is given. `speed`: seconds of its time in a second on the wall.

    >>> from palpate.twin.devices import TwinArray
    >>> from palpate.twin.world import World
    >>> array = PacedArray(TwinArray(World(None, seed=1)), speed=100.0)
    >>> array.read(timeout_s=1.0).sequence
    0
    """

    def __init__(self, array: PressureArray, *, speed: float) -> None:
        self._array, self._speed = array, speed
        self._anchor_s = math.nan
        self._hurry = Event()

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._array.layout

    @property
    def speed(self) -> float:
        """Seconds of simulated time in a second on the wall."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self._speed, self._anchor_s = speed, math.nan

    def hurry(self) -> None:
        """Let the frame that is held back go: something was asked that can't wait."""
        self._hurry.set()

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame when its time has come on the wall."""
        frame = self._array.read(timeout_s=timeout_s)
        # The anchor is the wall's time at which the sensor's clock would have read 0.
        now_s = time.monotonic()
        wait_s = self._anchor_s + frame.time_s / self._speed - now_s
        if not -1.0 < wait_s < 1.0:  # the first one, or the machine was asleep
            self._anchor_s, wait_s = now_s - frame.time_s / self._speed, 0.0
        if wait_s > 0 and self._hurry.wait(wait_s):
            self._anchor_s = math.nan
        self._hurry.clear()
        return frame

    def close(self) -> None:
        """Close the array."""
        self._array.close()
