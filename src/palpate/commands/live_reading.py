"""The state of `palpate live` at each frame: resistances against rest, the force, the link."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from palpate.arrays import FloatArray
from palpate.clock import Clock
from palpate.commands.sensor_source import SensorSource
from palpate.estimate.force_follower import FollowsForce
from palpate.estimate.measurement import Measurement
from palpate.sensor.array import Frame
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import CONTACT_PERCENT, excess_conductance, relative_change_percent

#: Without a calibration, the first second is taken for rest.
_REST_S = 1.0
#: A finger that touched has let go where no pixel shows this share of a contact any more.
_RELEASED_SHARE = 0.5
#: A frame is stale after five periods, at least 100 ms (as everywhere in palpate).
_STALE_PERIODS, _STALE_S = 5.0, 0.1


class LiveReading:
    """Takes frames, and knows what the last ones mean.

    `rest_ohm`, shape (rows, cols): calibrated rest values; None takes them from the first second.
    `clock`: the clock on the wall, for the age of the last frame.
    `force`: follows the force at every frame; None leaves it out.

    `ohm`, shape (rows, cols): resistances of the last frame.
    `change_percent`, shape (rows, cols): the same relative to rest, NaN where a pixel does not
        read; None before the rest is known.
    `force_n`: the force at the last frame.
    `touching`: fingers that touch something.
    `frames`, `lost`: frames that came, and gaps in their numbers.
    """

    def __init__(
        self,
        source: SensorSource,
        *,
        rest_ohm: FloatArray | None,
        clock: Clock,
        force: FollowsForce | None = None,
    ) -> None:
        self.source, self.calibrated = source, rest_ohm is not None
        self._layout = source.array.layout
        self.ohm: FloatArray | None = None
        self.change_percent: FloatArray | None = None
        self.force_n: Measurement | None = None
        self.touching: frozenset[int] = frozenset()
        self.frames = self.lost = 0
        self._rest_ohm, self._clock, self._force = rest_ohm, clock, force
        self._first: list[FloatArray] = []
        self._arrived_s = math.nan
        self._recent: deque[tuple[float, int]] = deque()

    def add(self, frame: Frame) -> None:
        """Take a frame."""
        self.ohm = pixel_resistance_ohm(
            frame.counts, layout=self._layout, oversampling=frame.oversampling
        )
        if self._recent:
            self.lost += max(0, frame.sequence - self._recent[-1][1] - 1)
        self.frames += 1
        self._arrived_s = self._clock.now_s()
        self._recent.append((frame.time_s, frame.sequence))
        while frame.time_s - self._recent[0][0] > 2.0:
            self._recent.popleft()
        if self._rest_ohm is None:
            self._learn_rest(self.ohm, frame.time_s)
        if self._rest_ohm is None:
            return
        self.change_percent = relative_change_percent(self.ohm, rest_ohm=self._rest_ohm)
        self.touching = frozenset(
            finger for finger in set(self._layout.finger_of_row) if self._touches(finger)
        )
        if self._force is not None:
            excess = excess_conductance(self.ohm, rest_ohm=self._rest_ohm)
            self.force_n = self._force.step(frame.time_s, excess)

    @property
    def rate_hz(self) -> float:
        """Frames per second over the last two seconds, lost ones included; NaN at the first."""
        if len(self._recent) < 2:
            return math.nan
        (start_s, start), (end_s, end) = self._recent[0], self._recent[-1]
        return (end - start) / (end_s - start_s) if end_s > start_s else math.nan

    @property
    def age_s(self) -> float:
        """Time since the last frame came; NaN before the first."""
        return self._clock.now_s() - self._arrived_s

    @property
    def stale(self) -> bool:
        """Whether frames should have come since."""
        period_s = 1.0 / self.rate_hz if self.rate_hz > 0 else 0.0
        return not self.age_s <= max(_STALE_S, _STALE_PERIODS * period_s)

    def _touches(self, finger: int) -> bool:
        assert self.change_percent is not None
        rows = np.array(self._layout.finger_of_row) == finger
        lowest = np.nanmin(self.change_percent[rows], initial=0.0)
        share = _RELEASED_SHARE if finger in self.touching else 1.0
        return bool(lowest <= share * CONTACT_PERCENT)

    def _learn_rest(self, ohm: FloatArray, time_s: float) -> None:
        self._first.append(ohm)
        if time_s - self._recent[0][0] >= _REST_S:
            self._rest_ohm = np.asarray(np.median(self._first, axis=0))
            self._first.clear()
