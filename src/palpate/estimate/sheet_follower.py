"""Force at every frame from the law of a sheet that was calibrated with a load cell."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.force_follower import ForceSource, TouchDetector
from palpate.estimate.gain import Gain
from palpate.estimate.sheet_law import SheetLaw
from palpate.estimate.sheet_states import SheetHistory
from palpate.measurement import Measurement

#: Largest excess conductance of any pixel of an empty hand, from offset and noise at rest.
_EMPTY_EXCESS = 0.03


class SheetFollower(ForceSource):
    """Estimates the force at every frame from the pixels and their history.

    Without contact the force is 0, and its upper limit is the detection threshold.

    `gain` (attribute): gain of the present contact, if a grasp has measured it.

    >>> from palpate.estimate.sheet_states import compute_states
    >>> time_s, force_n = np.arange(7.0), np.array([0.0, 1, 2, 4, 6, 8, 10])
    >>> law = SheetLaw.fit([(compute_states(time_s, force_n[:, None]), force_n)] * 3)
    >>> follower = SheetFollower(law)
    >>> follower.step(0.0, [[0.0, 0.0]]).value
    0.0
    >>> estimate = follower.step(1.0, [[2.0, 3.0]])
    >>> estimate.low < 5.0 < estimate.high
    True
    """

    def __init__(self, law: SheetLaw, *, level: float = 0.9) -> None:
        super().__init__()
        self.gain: Gain | None = None
        self._law, self._level = law, level
        self._threshold_n = law.threshold_n(level=level)
        self._history, self._touch = SheetHistory(), TouchDetector()

    def split_n(self, excess: FloatArray) -> FloatArray:
        return self._law.parts_n(excess)

    def _follow(self, time_s: float, excess: FloatArray) -> Measurement:
        seen = np.nansum(excess, keepdims=True) if self._law.pixels == 1 else excess
        states = self._history.step(time_s, seen)
        touched = self._touch.step(excess)
        if not touched and float(np.nanmax(excess, initial=0.0)) < _EMPTY_EXCESS:
            value, low, high = 0.0, 0.0, self._threshold_n
        else:
            found = self._law.force_n(states, gain=self.gain, level=self._level)
            value, low, high = (float(one[0]) for one in found)
            if not touched:
                low, high = 0.0, max(high, self._threshold_n)
        return Measurement(value=value, low=low, high=high, unit="n", level=self._level)
