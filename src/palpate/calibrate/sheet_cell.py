"""The calibrated sheet in place of a load cell, to measure a gripper's compliance without one."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibration import Calibration
from palpate.clock import Clock
from palpate.errors import CalibrationError
from palpate.force.of_calibration import force_now
from palpate.sensor.array import FRAME_TIMEOUT_S, ArrayLayout, Frame, PressureArray, read_waiting
from palpate.sensor.sample import SampleReader

#: The force is that of the mean reading over this span, and at least of these frames.
_MEAN_S, _FEWEST_FRAMES = 0.1, 3
#: A contact exceeds the forces that the unloaded sheet shows by this many of their standard
#: deviations, as in a grasp.
_TOUCH_SIGMAS = 6.0


class SheetCell:
    """An array whose frames also give the force: a `LoadCell` and the bench's array in one.

    `array`: the sensor, unloaded.
    `calibration`: force law of the sensor, and its rest values until `rest_ohm` is set to present
        ones, which drift.
    Raises `CalibrationError` if the calibration has no force law.

    >>> from palpate.clock import ManualClock
    >>> from palpate.twin.devices import TwinArray
    >>> from palpate.twin.rig import calibrate_twin
    >>> from palpate.twin.world import World
    >>> world = World(None, seed=1)
    >>> cell = SheetCell(
    ...     TwinArray(world),
    ...     clock=world.clock,
    ...     calibration=calibrate_twin(seed=1, level="lab", apart_from=""),
    ... )
    >>> cell.read_n()
    0.0
    """

    def __init__(self, array: PressureArray, *, clock: Clock, calibration: Calibration) -> None:
        self._array, self._clock = array, clock
        self._force = force_now(calibration)
        #: Rest values in use, shape (rows, cols).
        self.rest_ohm = calibration.rest_ohm
        self._recent: tuple[tuple[float, FloatArray], ...] = ()
        self._force_n = 0.0
        #: Upper limit of the present force, 90 % interval, newtons; infinite if there is none.
        self.high_n = 0.0

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._array.layout

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame; raises `DeviceError` as the array does."""
        frame = self._array.read(timeout_s=timeout_s)
        self._follow(frame)
        return frame

    def read_n(self) -> float:
        """Return the present grip force, newtons, 0 without contact.

        Raises `DeviceError` without a frame; `CalibrationError` if no pixel has a reading.
        """
        for frame in read_waiting(self._array, clock=self._clock, timeout_s=FRAME_TIMEOUT_S):
            self._follow(frame)
        return self._force_n

    def measure_noise_n(self, duration_s: float) -> float:
        """Return the force that the noise of the unloaded sheet does not reach, newtons.

        Raises errors as `read_n`.
        """
        shown_n, first_s = list[float](), self._clock.now_s()
        while self.read(timeout_s=FRAME_TIMEOUT_S).time_s < first_s + duration_s:
            shown_n.append(self._force_n)
        return float(np.mean(shown_n) + _TOUCH_SIGMAS * np.std(shown_n)) if shown_n else 0.0

    def close(self) -> None:
        """Close the array."""
        self._array.close()

    def _follow(self, frame: Frame) -> None:
        sample = SampleReader(self.layout, self.rest_ohm).read(frame)
        recent = (*self._recent, (sample.time_s, sample.excess))
        inside = sum(time_s > sample.time_s - _MEAN_S for time_s, _ in recent)
        self._recent = recent[-max(inside, _FEWEST_FRAMES) :]
        force = self._force.step(
            sample.time_s,
            np.mean([excess for _, excess in self._recent], axis=0),
            saturated=sample.has_saturated,
            lost=sample.has_lost,
        )
        if force.value is None:
            raise CalibrationError("no pixel has a reading; run `palpate doctor`")
        self._force_n, high_n = force.value, force.known_ends[1]
        self.high_n = float("inf") if high_n is None else high_n
