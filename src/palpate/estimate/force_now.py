"""Force now from a calibration's laws: after a movement, settled, and with memory.

A sheet that was just loaded reads by its early law, one at rest for long by its settled law;
between the two, creep is about even in the logarithm of time. A live view does not know when the
load moved, so the reading shows it: it leaves its own low-passed copy. Until the sheet has settled
the interval spans both laws.

These two use the pixels of this sheet, and no unloading. `ForceLaw` has learned from other
sensors how a sheet lags and unloads, and reads the sum of the pixels. Their errors differ, so the
answer is the mean of both in ln force.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.estimate.force import ForceEstimate, StaticLaw
from palpate.estimate.force_follower import ForceFollower, TouchDetector
from palpate.estimate.force_law import ForceLaw
from palpate.estimate.gain import Gain
from palpate.estimate.measurement import Measurement
from palpate.estimate.pixel_law import PixelReading

#: A load moved where the reading differs by this share from its copy of this time constant: creep
#: changes it by a few percent in that time.
_MOVED_FRACTION, _COPY_S = 0.2, 0.5
#: Readings below this are noise of the rest.
_FAINT = 0.02


#: A lower end of 0 N counts as this: its logarithm would decide alone.
_LEAST_N = 1e-3
#: A hand whose every pixel shows less excess conductance is empty: offset and noise of the rest.
_EMPTY = 0.03


class ForceLaws(NamedTuple):
    """The laws of a calibration.

    `reading`: from pixels to what the laws read.
    `early`, `settled`: force soon after a movement, and settled.
    `memory`: force at any time by the sum of the pixels; None to do without.
    """

    reading: PixelReading
    early: StaticLaw
    settled: StaticLaw
    memory: ForceLaw | None = None


class ContactGains(NamedTuple):
    """Gain of the present contact by each of the two laws; None where unknown."""

    early: Gain | None = None
    settled: Gain | None = None


class ForceNow:
    """Newtons with an interval at every frame.

    `early_s`, `settled_s`: times after a movement at which the two laws were calibrated.
    `gains`, an attribute: of the present contact, where a grasp has shown them.

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
        self._laws, self.gains = laws, ContactGains()
        self._early_s, self._settled_s, self._level = early_s, settled_s, level
        self._memory = None if laws.memory is None else ForceFollower(laws.memory)
        self._copy, self._touch = 0.0, TouchDetector()
        self._last_s = self._moved_s = -math.inf

    def step(self, time_s: float, excess: ArrayLike) -> Measurement:
        """Take a frame and return the force now; 0 with an upper end without contact.

        `time_s`: not earlier than the last one.
        `excess`, shape (rows, cols): excess conductance of each pixel; NaN where one does not read.
        """
        seen = float(self._laws.reading.reading(excess))
        fraction = -math.expm1(-max(time_s - self._last_s, 0.0) / _COPY_S)
        self._copy += fraction * (seen - self._copy)
        if self._last_s == -math.inf or abs(seen - self._copy) > max(
            _MOVED_FRACTION * self._copy, _FAINT
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
        # A pixel's law begins steeply: noise and offset of an empty hand would read as newtons.
        touched = self._touch.step(excess)
        empty = float(np.nanmax(np.asarray(excess, dtype=float), initial=0.0)) < _EMPTY
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
        # What a grasp showed of its contact is known for the laws of the calibration alone.
        if not touched or empty or self.gains != ContactGains():
            return force
        return _combine(force, other)

    def _force(self, law: StaticLaw, seen: float, gain: Gain | None) -> ForceEstimate:
        force = law.force_n(seen, level=self._level)
        return force if gain is None else gain.apply_to(force)


def _combine(one: Measurement, other: Measurement) -> Measurement:
    """Return the mean of two ln forces, wider by their distance from it."""
    value = math.sqrt(one.middle * other.middle)
    apart = abs(math.log(one.middle / other.middle)) / 2.0
    down, up = (
        math.hypot(
            0.5 * sum(abs(math.log(max(end, _LEAST_N) / each.middle)) for end, each in ends), apart
        )
        for ends in (((one.low, one), (other.low, other)), ((one.high, one), (other.high, other)))
    )
    return replace(one, value=value, low=value * math.exp(-down), high=value * math.exp(up))
