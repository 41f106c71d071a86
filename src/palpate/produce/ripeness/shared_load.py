"""Number of pixels that share an item's load, corrected for size and force.

Under the same force a soft item lies against more of the pad than a hard one does; but so does a
larger one, and one that is pressed harder. All three act on the radius of contact through one
number (Hertz): it goes with the cube root of F R^1.5 / c, where c is the force at 1 mm. So an item
counts as soft as one of the usual size under the usual force with the same F R^1.5 / c, and the
effect of size and force on the sharing is corrected by its measured rise with the force.

Each grasp shows that rise itself while it closes. Where few pixels are reached it is zero, and
never more than the cube root, because the pixels of a finger lie in a row.

Sharing as it is read judges stages worse: on two simulated sensors of level lab (192 fruit days)
the log loss of the true stage is 0.29 instead of 0.25 (90 % interval of the difference 0.02 to
0.07). At level field, and for the days to ripe, the difference is not significant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.measurement import Measurement
from palpate.grasp.estimator import Observation
from palpate.grasp.result import GraspResult
from palpate.produce.answer_pixels import MEAN_S, answer_time_s, mean_percent_before
from palpate.produce.records import MEASURED
from palpate.produce.ripeness.closing import CONTACT_WIDTH
from palpate.produce.ripeness.firmness import RIPENESS_N, minus_log_sharing
from palpate.sensor.array import ArrayLayout
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import relative_change_percent, total_excess

#: Name of this measurement.
NAME = "shared_pixels"
#: Sharing is given as for an item of this width, mm.
_USUAL_MM = 60.0
#: Hertz, see above: the power of R relative to that of F, and that of both in the radius.
_SIZE_POWER, _RADIUS_POWER = 1.5, 1.0 / 3.0
#: Excess conductance of Velostat goes with about this power of the force.
_EXCESS_POWER = 1.3
#: The rise of the sharing is taken from this fraction of the last load.
_EARLIER = 0.5
#: A pixel's resistance does not fall to less than this.
_LEAST_LEFT_PERCENT = 0.1


def fraction_of_pixels(
    observations: Sequence[Observation],
    *,
    result: GraspResult,
    layout: ArrayLayout,
    measured: Mapping[str, Measurement],
) -> dict[str, Measurement]:
    """Return the pixel count as a named measurement; empty without the contact width.

    Its interval extends from the uncorrected count to the full cube-root correction.

    `measured`: what was measured: `force_n` and `contact_mm` are used.
    """
    until_s = answer_time_s(result)
    width, force = measured.get(CONTACT_WIDTH), measured.get("force_n")
    if until_s is None or width is None or force is None or min(width.middle, force.middle) <= 0:
        return {}
    held = mean_percent_before(until_s, observations=observations, layout=layout)
    sharing = minus_log_sharing(held)
    if sharing is None:
        return {}
    beyond = math.log(force.middle / RIPENESS_N) + _SIZE_POWER * math.log(width.middle / _USUAL_MM)
    closing = _until_largest_pressure(observations, until_s=until_s)
    rise = _sharing_exponent(closing, held=held, layout=layout)
    value, read, most = (
        math.exp(-sharing - power * beyond) for power in (rise, 0.0, _RADIUS_POWER)
    )
    return {
        NAME: Measurement(
            value=value, low=min(read, most), high=max(read, most), unit=MEASURED[NAME]
        )
    }


def _until_largest_pressure(
    observations: Sequence[Observation], *, until_s: float
) -> Sequence[Observation]:
    """Return the observations until the fingers' largest pressure."""
    pressure_kpa = [one.gripper.pressure_kpa for one in observations if one.frame.time_s <= until_s]
    return observations[: int(np.nanargmax(pressure_kpa)) + 1]


def _sharing_exponent(
    closing: Sequence[Observation], *, held: FloatArray, layout: ArrayLayout
) -> float:
    """Return the force exponent of load sharing over the last half of the load.

    It is 0 where none of the load, or no less of it, was carried in the mean up to that moment.
    """
    light = np.flatnonzero(
        _total_load(_change_percent(closing, layout=layout)) < _EARLIER * _total_load(held)
    )
    if not light.size:
        return 0.0
    at_s = closing[int(light[-1])].frame.time_s
    earlier = mean_percent_before(at_s, observations=closing, layout=layout)
    before, after = minus_log_sharing(earlier), minus_log_sharing(held)
    light_load, load = float(_total_load(earlier)), float(_total_load(held))
    if before is None or after is None or not 0.0 < light_load < load:
        return 0.0
    rise = _EXCESS_POWER * (before - after) / math.log(load / light_load)
    return min(max(rise, 0.0), _RADIUS_POWER)


def _change_percent(observations: Sequence[Observation], *, layout: ArrayLayout) -> FloatArray:
    """Return the relative change in every frame, shape (frames, rows, cols)."""
    first = observations[0].frame
    ohm = pixel_resistance_ohm(
        np.stack([one.frame.counts for one in observations]),
        layout=layout,
        oversampling=first.oversampling,
    )
    rested = [one.frame.time_s < first.time_s + MEAN_S for one in observations]
    return relative_change_percent(ohm, rest_ohm=ohm[rested].mean(axis=0))


def _total_load(percent: FloatArray) -> FloatArray:
    """Return the excess conductance summed over pixels."""
    left = np.maximum(100.0 + percent, _LEAST_LEFT_PERCENT) / 100.0
    return total_excess(1.0 / left - 1.0)
