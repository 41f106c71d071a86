"""Real-time frames of `palpate live`, with pixel changes, force and link state."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator

import numpy as np

from palpate.arrays import FloatArray
from palpate.cli.sensor_source import SensorSource
from palpate.clock import Clock
from palpate.errors import DeviceTimeoutError
from palpate.force.force_follower import ForceSource
from palpate.grasp.safety import SafetyLimits
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.measurement import Measurement
from palpate.rig.paced_array import PacedArray
from palpate.sensor.array import Frame
from palpate.sensor.sample import SampleReader
from palpate.signal.events import ContactState, watch_contact
from palpate.signal.relative import mean_change

#: Duration of the rest measurement without a calibration, seconds.
_REST_S = 1.0
_SAFETY = SafetyLimits()
#: Short read timeout, so that the view shows a silent sensor promptly.
_WAIT_S = 0.2
#: Steps of the demonstration squeeze: fraction of the gripper's maximum rate, mean relative change
#: to stop at, percent, and hold time, seconds.
_STEPS = ((0.3, -3.0, 0.0), (0.02, -30.0, 4.0), (0.02, -50.0, 4.0))
#: Time that the gripper stays open, seconds.
_OPEN_S = 5.0


class LiveReading:
    """State of the sensor after the latest frames.

    Arguments:
    `rest_ohm`, shape (rows, cols): calibrated rest values; None to measure them first.
    `clock`: real-time clock, for the age of the last frame.
    `force`: force tracker; None disables the force.

    Attributes:
    `ohm`, shape (rows, cols): resistances of the last frame.
    `change_percent`, shape (rows, cols): changes relative to rest, NaN for pixels without a
        reading; None before the rest values are known.
    `force_n`: force at the last frame.
    `frames`, `lost`: numbers of received and of lost frames.
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
        self._contacts = dict.fromkeys(self._layout.finger_of_row, ContactState())
        self.frames = self.lost = 0
        self._reader = SampleReader(source.array.layout, rest_ohm)
        self._clock, self._force = clock, force
        self._first: list[FloatArray] = []
        self._arrived_s = math.nan
        self._recent: deque[tuple[float, int]] = deque()

    def add(self, frame: Frame) -> None:
        """Add a frame."""
        sample = self._reader.read(frame)
        self.ohm = sample.resistance_ohm
        if self._recent:
            self.lost += max(0, frame.sequence - self._recent[-1][1] - 1)
        self.frames += 1
        self._arrived_s = self._clock.now_s()
        self._recent.append((frame.time_s, frame.sequence))
        while frame.time_s - self._recent[0][0] > 2.0:
            self._recent.popleft()
        if self._reader.rest_ohm is None:
            self._collect_rest(self.ohm, frame.time_s)
            return
        self.change_percent = sample.change_percent
        for finger, state in self._contacts.items():
            rows = np.array(self._layout.finger_of_row) == finger
            lowest = float(np.nanmin(self.change_percent[rows], initial=0.0))
            self._contacts[finger], _ = watch_contact(state, lowest)
        if self._force is not None:
            self.force_n = self._force.step(
                sample.time_s, sample.excess, saturated=sample.has_saturated, lost=sample.has_lost
            )

    @property
    def touching(self) -> frozenset[int]:
        """Fingers whose lowest pixel is in contact."""
        return frozenset(f for f, state in self._contacts.items() if state.is_touching)

    @property
    def rate_hz(self) -> float:
        """Frames per second over the last two seconds, with lost frames; NaN after one frame."""
        if len(self._recent) < 2:
            return math.nan
        (start_s, start), (end_s, end) = self._recent[0], self._recent[-1]
        return (end - start) / (end_s - start_s) if end_s > start_s else math.nan

    @property
    def age_s(self) -> float:
        """Time since the last frame; NaN before the first."""
        return self._clock.now_s() - self._arrived_s

    @property
    def is_stale(self) -> bool:
        """Whether the next frame is overdue."""
        period_s = 1.0 / self.rate_hz if self.rate_hz > 0 else 0.0
        return not self.age_s <= _SAFETY.stale_after_s(period_s)

    def _collect_rest(self, ohm: FloatArray, time_s: float) -> None:
        self._first.append(ohm)
        if time_s - self._recent[0][0] >= _REST_S:
            self._reader = SampleReader(self._layout, np.median(self._first, axis=0))
            self._first.clear()


def pace_frames(source: SensorSource) -> Iterator[Frame | None]:
    """Yield frames as they arrive, and None after each read timeout.

    `source`: an open sensor. A simulated sensor is squeezed, and paced to real time.
    """
    if source.gripper is None or source.calibration is None:
        while True:
            try:
                yield source.array.read(timeout_s=_WAIT_S)
            except DeviceTimeoutError:
                yield None
    squeezing = squeeze(source.gripper)
    reader = SampleReader(source.array.layout, source.calibration.rest_ohm)
    next(squeezing)
    array = PacedArray(source.array, speed=1.0)
    while True:
        frame = array.read(timeout_s=1.0)
        change = mean_change(reader.read(frame).change_percent)
        squeezing.send((frame.time_s, float(change)))
        yield frame


def squeeze(gripper: Gripper) -> Generator[None, tuple[float, float], None]:
    """Repeatedly close a simulated gripper in steps, hold, and open it.

    Send it the time and the mean relative change, percent, of each frame.
    """
    limits = gripper.limits
    closed = limits.lowest if limits.drive == "width" else limits.highest
    time_s, change = yield
    while True:
        gripper.release()
        until_s = time_s + _OPEN_S
        for rate, depth_percent, hold_s in _STEPS:
            while time_s < until_s:
                time_s, change = yield
            gripper.command(GripperCommand(target=closed, rate=rate * limits.fastest))
            is_moving = True
            while is_moving and change > depth_percent:
                time_s, change = yield
                is_moving = gripper.state().moving
            if hold_s:
                gripper.stop()
            until_s = time_s + hold_s
        while time_s < until_s:
            time_s, change = yield
