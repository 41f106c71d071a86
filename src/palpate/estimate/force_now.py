"""Present force from a calibration's laws: early, settled, and with memory.

The early law applies just after a load change, the settled law after a long rest. In between, creep
is approximately uniform in the logarithm of time. A live view detects load changes from the
difference between the reading and its low-passed copy. Until the sheet has settled, the interval
covers both laws.

These two laws use the individual pixels of this sheet, and do not model unloading. `ForceLaw`
models lag and unloading, learned from other sensors, and uses the sum of the pixels. The result is
the mean of both in ln force, because their errors differ.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.force import ForceEstimate, StaticLaw
from palpate.estimate.force_follower import ForceFollower, ForceSource, TouchDetector
from palpate.estimate.force_law import ForceLaw
from palpate.estimate.gain import Gain
from palpate.estimate.pixel_law import PixelReading
from palpate.measurement import Measurement

#: Relative difference between the reading and its low-passed copy that is a load change, and time
#: constant of the copy, in which creep is only a few percent.
_MOVED_FRACTION, _COPY_S = 0.2, 0.5
#: Smallest difference above the noise at rest.
_MIN_DIFFERENCE = 0.02
#: Smallest lower limit, newtons, to keep its logarithm finite.
_LEAST_N = 1e-3
#: Largest excess conductance of any pixel of an empty hand, from offset and noise at rest.
_EMPTY = 0.03


class ForceLaws(NamedTuple):
    """Force laws of a calibration.

    `reading`: converts pixels to the input of `early` and `settled`.
    `early`, `settled`: force soon after a movement, and settled force.
    `memory`: force at any time, from the sum of the pixels; optional.
    """

    reading: PixelReading
    early: StaticLaw
    settled: StaticLaw
    memory: ForceLaw | None = None


class ContactGains(NamedTuple):
    """Gain of the present contact relative to the early law and to the settled law.

    None if unknown.
    """

    early: Gain | None = None
    settled: Gain | None = None


class ForceNow(ForceSource):
    """Estimates the force with an interval at every frame.

    `early_s`, `settled_s`: times after a movement at which the two laws were calibrated.
    `gains` (attribute): gains of the present contact, if a grasp has measured them.

    >>> from palpate.estimate.pixel_law import PixelForceLaw
    >>> law = PixelForceLaw(log_scale=0.0, exponent=1.0, residual_sd=0.1, floor_n=0.01,
    ...     range=(0.1, 10.0))
    >>> laws = ForceLaws(PixelReading.sum_pixels(), early=law, settled=law)
    >>> now = ForceNow(laws, early_s=0.4, settled_s=20.0)
    >>> estimate = now.step(0.0, [[1.0, 1.0]])
    >>> round(estimate.value, 2), estimate.low < 2.0 < estimate.high
    (2.0, True)
    """

    def __init__(
        self, laws: ForceLaws, *, early_s: float, settled_s: float, level: float = 0.9
    ) -> None:
        super().__init__()
        self._laws, self.gains = laws, ContactGains()
        self._early_s, self._settled_s, self._level = early_s, settled_s, level
        self._memory = None if laws.memory is None else ForceFollower(laws.memory)
        self._copy, self._touch = 0.0, TouchDetector()
        self._last_s = self._moved_s = -math.inf

    def _follow(self, time_s: float, excess: FloatArray) -> Measurement:
        seen = float(self._laws.reading.reading(excess))
        fraction = -math.expm1(-max(time_s - self._last_s, 0.0) / _COPY_S)
        self._copy += fraction * (seen - self._copy)
        if self._last_s == -math.inf or abs(seen - self._copy) > max(
            _MOVED_FRACTION * self._copy, _MIN_DIFFERENCE
        ):
            self._moved_s = time_s
        self._last_s = time_s
        span = math.log(self._settled_s / self._early_s)
        rested = math.log(max(time_s - self._moved_s, self._early_s) / self._early_s) / span
        weight = min(rested, 1.0)
        both = [
            self._force(self._laws.early, seen, self.gains.early),
            self._force(self._laws.settled, seen, self.gains.settled),
        ]
        used = both if weight < 1.0 else both[1:]
        values = np.maximum([float(one.value) for one in both], 1e-6)
        value = float(np.exp((1 - weight) * np.log(values[0]) + weight * np.log(values[1])))
        # A pixel's law is steep at first: noise and offset of an empty hand would read as newtons.
        touched = self._touch.step(excess)
        empty = float(np.nanmax(excess, initial=0.0)) < _EMPTY
        force = Measurement(
            value=0.0 if empty else value,
            low=min(value, *(float(one.low) for one in used)) if touched else 0.0,
            high=max(value, *(float(one.high) for one in used)),
            unit="n",
            level=self._level,
        )
        if self._memory is None:
            return force
        other = self._memory.step(time_s, excess)
        # The gains apply only to the calibration's two laws.
        if not touched or empty or self.gains != ContactGains():
            return force
        return force.combined(other, least=_LEAST_N)

    def _force(self, law: StaticLaw, seen: float, gain: Gain | None) -> ForceEstimate:
        force = law.force_n(seen, level=self._level)
        return force if gain is None else gain.apply_to(force)
