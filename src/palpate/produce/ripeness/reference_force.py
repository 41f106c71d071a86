"""What a reference object tells of the forces that fingers driven by width read on it.

On one width its force is one. So the width at which a grasp held says how much more force was read
than there was; and with many grasps, whose errors these are:

- What goes with the say of the servo's current (`palpate.produce.ripeness.closing`) is the
  current's own. That share of it is left out, down to the sheet alone where that repeats better.
- What goes with the hour is a servo that warms up, told by grasps before the fruit and after it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.estimate.measurement import Measurement
from palpate.produce.records import Grasp
from palpate.produce.ripeness.closing import log_gain
from palpate.produce.ripeness.firmness import RIPENESS_N, by_day, firmness_of

#: How much more steeply than by its secant a ball's force rises: between a spring and Hertz (1.5).
_STEEPER = 1.25
#: Grasps further apart than this, in hours, are of another morning.
_MORNING_H = 6.0
#: Before anything was felt: by so much, in ln force and an hour, does a warming servo change.
_WARMING_SD_PER_H = 0.05
#: Gains that differ by less than this (variance) are no witness's say.
_NO_SAY = 1e-8
_HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceRead:
    """How the forces read on a reference object were off."""

    #: ln of the force read over the true one in each grasp, but for a constant, without what is
    #: named below.
    read: tuple[tuple[datetime, float], ...]
    #: Share of what other witnesses than the sheet say that is left out, and ln of the gain that
    #: they give a contact on the average, which stays.
    left_out: float
    usual_gain: float
    #: How ln force changes over a morning, and as far from its middle as this was felt.
    warming_per_h: float
    reach_h: float

    @classmethod
    def by_width(cls, grasps: Sequence[Grasp], *, give_mm_per_n: float) -> ForceRead:
        """Learn from grasps of the object.

        From the width to which the hand would have closed for 5 N read; how steeply force rises
        over width follows from the gripper's give and the object's own firmness on its first day.
        """
        felt = [
            (grasp, width, force, firmness)
            for grasp in sorted(grasps, key=lambda one: one.taken_at)
            if (width := grasp.measurements.get("width_mm")) is not None
            and (force := grasp.measurements.get("force_n")) is not None
            and (firmness := firmness_of(grasp)) is not None
        ]
        if not felt:
            return cls(read=(), left_out=0.0, usual_gain=0.0, warming_per_h=0.0, reach_h=0.0)
        first = by_day((grasp.taken_at, firmness) for grasp, _, _, firmness in felt)[0]
        way_mm_per_n = give_mm_per_n + math.exp(-first.firmness) / _STEEPER
        off = np.array([_off(width, force, way_mm_per_n) for _, width, force, _ in felt])
        gain = np.array([log_gain(grasp) or 0.0 for grasp, *_ in felt])
        at = [grasp.taken_at for grasp, *_ in felt]
        hours = np.array([(one - at[0]).total_seconds() / _HOUR_S for one in at])
        left_out, usual_gain = _left_out(off, gain=gain, hours=hours), float(gain.mean())
        off = off - left_out * (gain - usual_gain)
        since_h = _since_middle(hours)
        warming_per_h = _warming(off, since_h=since_h, hours=hours)
        off = off - warming_per_h * since_h
        return cls(
            read=tuple(zip(at, (off - off[0]).tolist(), strict=True)),
            left_out=left_out,
            usual_gain=usual_gain,
            warming_per_h=warming_per_h,
            reach_h=float(np.sqrt(np.mean(since_h**2))),
        )

    def warmed(self, since_h: float) -> float:
        """Return the change of ln force read, so many hours after the middle of a morning."""
        if abs(since_h) > _MORNING_H:
            return 0.0
        return self.warming_per_h * min(max(since_h, -self.reach_h), self.reach_h)

    def said_too_much(self, grasp: Grasp) -> float:
        """Return what the other witnesses of a grasp added to ln force that is to be left out."""
        gain = log_gain(grasp)
        return 0.0 if gain is None else self.left_out * (gain - self.usual_gain)


def _off(width: Measurement, force: Measurement, way_mm_per_n: float) -> float:
    """Return ln of the force read over the true one, but for a constant."""
    at_usual_mm = width.value + way_mm_per_n * (force.value - RIPENESS_N)
    return at_usual_mm / (way_mm_per_n * RIPENESS_N)


def _left_out(off: FloatArray, *, gain: FloatArray, hours: FloatArray) -> float:
    """Return the share of the gains without which grasps of one morning repeat best.

    Least squares of how the forces of neighbours differ over how their gains do.
    """
    near = np.diff(hours) < _MORNING_H
    apart, said = np.diff(off)[near], np.diff(gain)[near]
    return min(max(float(apart @ said) / max(float(said @ said), _NO_SAY), 0.0), 1.0)


def _mornings(hours: FloatArray) -> NDArray[np.int64]:
    """Return the number of each grasp's morning."""
    return np.cumsum(np.diff(hours, prepend=hours[0]) > _MORNING_H)


def _since_middle(hours: FloatArray) -> FloatArray:
    """Return the hours since the mean time of each grasp's morning."""
    return hours - _means(hours, hours=hours)


def _means(values: FloatArray, *, hours: FloatArray) -> FloatArray:
    """Return for each grasp the mean over its morning."""
    number = _mornings(hours)
    return np.asarray((np.bincount(number, values) / np.bincount(number))[number])


def _warming(off: FloatArray, *, since_h: FloatArray, hours: FloatArray) -> float:
    """Return the slope over the hours that all mornings share, leant on none."""
    moved = off - _means(off, hours=hours)
    freedom = off.size - np.unique(_mornings(hours)).size - 1
    if freedom < 1:
        return 0.0
    free = moved - since_h * (moved @ since_h) / max(float(since_h @ since_h), _NO_SAY)
    doubt = float(free @ free) / freedom / _WARMING_SD_PER_H**2
    return float(moved @ since_h) / max(float(since_h @ since_h) + doubt, _NO_SAY)
