"""Force at every frame from the dead-weight law, and the most useful next weight."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.force.force_law import ForceLaw
from palpate.force.force_states import ForceStates, log_reading
from palpate.measurement import Measurement, Status
from palpate.sensor.sample import excess_of_change
from palpate.signal.relative import CONTACT_PERCENT

#: Excess conductance above which a pixel has contact (paper, section 4.1, as conductance); contact
#: ends below half of it.
_TOUCHED = float(excess_of_change(CONTACT_PERCENT))


T = TypeVar("T")


class HistoryFollower(ABC, Generic[T]):
    """Follows frames whose meaning depends on earlier ones.

    A single saturated frame may be a disturbance: it enters the history only if the next frame is
    saturated too, so that the next good frame is read right.
    """

    def __init__(self) -> None:
        #: The single saturated frame before this one, and whether more than one was saturated.
        self._single: tuple[float, FloatArray] | None = None
        self._stays_saturated = False

    def follow(self, time_s: float, excess: FloatArray, *, saturated: bool = False) -> T:
        """Process a frame, NaN for pixels without a reading, and return what it shows."""
        if not saturated:
            self._single, self._stays_saturated = None, False
            return self._follow(time_s, excess)
        if self._stays_saturated or self._single is not None:
            if self._single is not None:
                self._follow(*self._single)
            self._single, self._stays_saturated = None, True
            return self._follow(time_s, excess)
        self._single = (time_s, excess)
        return copy.deepcopy(self)._follow(time_s, excess)

    @abstractmethod
    def _follow(self, time_s: float, excess: FloatArray) -> T:
        """Add a frame to the history and return what it shows."""


class ForceSource(HistoryFollower[Measurement]):
    """Converts frames to the present force.

    A frame without a readable pixel is not measured. With a saturated pixel, or one that has lost
    its reading, the force is a lower bound.
    """

    def step(
        self, time_s: float, excess: ArrayLike, *, saturated: bool = False, lost: bool = False
    ) -> Measurement:
        """Process a frame and return the present force; without contact, 0 with an upper limit.

        `time_s`: not earlier than that of the last frame.
        `excess`, shape (rows, cols): excess conductance, as in a `Sample`; NaN for pixels
            without a reading. Of an infinite excess nothing is known, and its pixel is saturated.
        `saturated`: whether a pixel is saturated.
        `lost`: whether a pixel with a reading at rest has none.
        """
        grid = np.asarray(excess, dtype=float)
        short = np.isposinf(grid)
        if short.any():
            saturated, grid = True, np.where(short, 0.0, grid)
        if np.isnan(grid).all():
            return Measurement(
                value=None,
                low=0.0,
                high=np.inf,
                unit="n",
                status=Status.NOT_MEASURED,
                reason="no pixel has a reading",
            )
        force = self.follow(time_s, grid, saturated=saturated)
        if saturated:
            return replace(force, status=Status.AT_LEAST, reason="a pixel is saturated")
        if lost:
            return replace(force, status=Status.AT_LEAST, reason="a pixel has no reading")
        return force

    @abstractmethod
    def split_n(self, excess: FloatArray) -> FloatArray:
        """Return each pixel's part of the force, up to a common factor, in the frame's shape."""


class TouchDetector:
    """Detects contact of any pixel, with hysteresis.

    `law`: law of the sheet, if its smallest calibrated reading may be below the threshold.

    >>> detector = TouchDetector()
    >>> [detector.step([[excess]]) for excess in (0.05, 0.2, 0.08, 0.02)]
    [False, True, True, False]
    """

    def __init__(self, law: ForceLaw | None = None) -> None:
        self._touched = False
        # On a sheet that hardly responds, no pixel reaches the usual threshold under a known load.
        least = np.inf if law is None else law.least_reading
        self._total = 0.5 * least if least < 2.0 * _TOUCHED else np.inf

    def step(self, excess: ArrayLike) -> bool:
        """Return whether a frame shows contact; `excess` has shape (rows, cols)."""
        grid = np.asarray(excess, dtype=float)
        fraction = 0.5 if self._touched else 1.0
        highest = float(np.nanmax(grid, initial=0.0))
        self._touched = (
            highest > _TOUCHED * fraction or float(np.nansum(grid)) > self._total * fraction
        )
        return self._touched


class ForceFollower(ForceSource):
    """Estimates the force at every frame from the summed excess conductance and its history.

    Without any measured force, the law is that of other sensors, and the interval is wide:

    >>> follower = ForceFollower(ForceLaw())
    >>> follower.step(0.0, [[0.0, 0.01]]).value
    0.0
    >>> answer = follower.step(0.1, [[12.0, 8.0]])
    >>> 0 < answer.low < answer.value < answer.high
    True
    """

    def __init__(self, law: ForceLaw) -> None:
        super().__init__()
        self._law, self._states, self._touch = law, ForceStates(), TouchDetector(law)

    def split_n(self, excess: FloatArray) -> FloatArray:
        return np.maximum(np.nan_to_num(excess), 0.0)

    def _follow(self, time_s: float, excess: FloatArray) -> Measurement:
        total = float(np.nansum(excess))
        inputs = self._states.step(time_s, float(log_reading(self._law.scale * total)))
        inputs[0] = log_reading(total)
        return self._law.force(inputs, touched=self._touch.step(excess))
