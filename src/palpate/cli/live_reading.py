"""Frames of `palpate live` in real time, with pixels, force and link at each."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator

import numpy as np

from palpate.arrays import FloatArray
from palpate.cli.sensor_source import SensorSource
from palpate.clock import Clock
from palpate.errors import DeviceTimeoutError
from palpate.estimate.force_follower import ForceSource
from palpate.estimate.measurement import Measurement
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.sensor.array import Frame
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import (
    CONTACT_PERCENT,
    excess_conductance,
    mean_change,
    relative_change_percent,
)

#: Without a calibration, the first second is taken for rest.
_REST_S = 1.0
#: A finger that touched is released where no pixel shows this fraction of a contact any more.
_RELEASED_SHARE = 0.5
#: A frame is stale after five periods, at least 100 ms (as everywhere in palpate).
_STALE_PERIODS, _STALE_S = 5.0, 0.1

#: A silent sensor is shown as such, so a read must not wait long.
_WAIT_S = 0.2
#: Close fast to a touch, then slowly to two depths: fraction of the gripper's greatest rate, mean
#: relative change, percent, and the time that it is kept, seconds.
_STEPS = ((0.3, -3.0, 0.0), (0.02, -30.0, 4.0), (0.02, -50.0, 4.0))
#: Time that the gripper stays open, seconds.
_OPEN_S = 5.0


class LiveReading:
    """State of the sensor after the latest frames.

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
        force: ForceSource | None = None,
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
        """Time since the last frame; NaN before the first."""
        return self._clock.now_s() - self._arrived_s

    @property
    def stale(self) -> bool:
        """Whether the next frame is overdue."""
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


def pace_frames(source: SensorSource, *, clock: Clock) -> Iterator[Frame | None]:
    """Yield frames as they arrive; None after a pause.

    `source`: an open sensor. A simulated one is held back to the pace of `clock`.
    `clock`: the clock on the wall.
    """
    if source.gripper is None or source.calibration is None:
        while True:
            try:
                yield source.array.read(timeout_s=_WAIT_S)
            except DeviceTimeoutError:
                yield None
    squeezing, rest_ohm = squeeze(source.gripper), source.calibration.rest_ohm
    next(squeezing)
    first_s, start_s = None, clock.now_s()
    while True:
        frame = source.array.read(timeout_s=1.0)
        first_s = frame.time_s if first_s is None else first_s
        clock.sleep_s(start_s + frame.time_s - first_s - clock.now_s())
        ohm = pixel_resistance_ohm(
            frame.counts, layout=source.array.layout, oversampling=frame.oversampling
        )
        change = mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))
        squeezing.send((frame.time_s, float(change)))
        yield frame


def squeeze(gripper: Gripper) -> Generator[None, tuple[float, float], None]:
    """Close a simulated gripper in steps, hold, open it, and repeat.

    Takes the time and the mean relative change, percent, of each frame.
    """
    limits = gripper.limits
    closed = limits.lowest if limits.drive == "width" else limits.highest
    time_s, change = yield
    while True:
        gripper.release()
        until_s = time_s + _OPEN_S
        for rate, depth_percent, keep_s in _STEPS:
            while time_s < until_s:
                time_s, change = yield
            gripper.command(GripperCommand(target=closed, rate=rate * limits.fastest))
            is_moving = True
            while is_moving and change > depth_percent:
                time_s, change = yield
                is_moving = gripper.state().moving
            if keep_s:
                gripper.stop()
            until_s = time_s + keep_s
        while time_s < until_s:
            time_s, change = yield
