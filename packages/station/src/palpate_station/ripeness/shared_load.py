"""Number of pixels that share an item's load, corrected for size and force.

Under the same force a soft item touches more pixels than a hard item. A larger item and a larger
force also increase the contact radius. All three act through one quantity (Hertz): the radius is
proportional to the cube root of F R^1.5 / c, where c is the force at 1 mm. The pixel count is
therefore converted to a reference width and force, with the exponent of its rise with the force.

Each grasp measures this exponent while it closes. The exponent is 0 if only few pixels are loaded,
and at most 1/3, because the pixels of a finger form a row.

Without the correction stages are less accurate: on two simulated sensors of level lab (192 fruit
days) the log loss of the true stage is 0.29 instead of 0.25 (90 % interval of the difference 0.02
to 0.07). At level field, and for the days to ripe, the difference is not significant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.estimator import Observation
from palpate.grasp.result import GraspResult
from palpate.measurement import Measurement
from palpate.sensor.array import ArrayLayout
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.sample import SampleReader, excess_of_change
from palpate.signal.relative import total_excess
from palpate_station.answer_pixels import MEAN_S, answer_time_s, mean_percent_before
from palpate_station.records import MEASURED
from palpate_station.ripeness.closing import CONTACT_WIDTH
from palpate_station.ripeness.firmness import RIPENESS_N, minus_log_sharing

#: Name of this measurement.
SHARED_PIXELS = "shared_pixels"
#: Width of an item that the pixel count is converted to, mm.
_REFERENCE_MM = 60.0
#: Hertz exponents (see above) of R relative to F, and of F in the contact radius.
_SIZE_POWER, _RADIUS_POWER = 1.5, 1.0 / 3.0
#: Exponent of the excess conductance of Velostat over force (approximate).
_EXCESS_POWER = 1.3
#: The exponent of the sharing is measured from this fraction of the final load on.
_EARLIER_LOAD = 0.5


def measure_shared_pixels(
    observations: Sequence[Observation],
    *,
    result: GraspResult,
    layout: ArrayLayout,
    measured: Mapping[str, Measurement],
) -> dict[str, Measurement]:
    """Return the corrected pixel count by name; empty without width, force or load.

    The interval extends from the uncorrected count to the full cube-root correction.

    `measured`: measurements of the grasp; uses `force_n` and `contact_mm`.
    """
    until_s = answer_time_s(result)
    width, force = measured.get(CONTACT_WIDTH), measured.get("force_n")
    if until_s is None or width is None or force is None or not force.has_value:
        return {}
    if min(width.middle, force.middle) <= 0:
        return {}
    held = mean_percent_before(until_s, observations=observations, layout=layout)
    sharing = minus_log_sharing(held)
    if sharing is None:
        return {}
    log_excess = math.log(force.middle / RIPENESS_N) + _SIZE_POWER * math.log(
        width.middle / _REFERENCE_MM
    )
    closing = _select_closing(observations, until_s=until_s)
    exponent = _sharing_exponent(closing, held=held, layout=layout)
    value, uncorrected, fully_corrected = (
        math.exp(-sharing - power * log_excess) for power in (exponent, 0.0, _RADIUS_POWER)
    )
    return {
        SHARED_PIXELS: Measurement(
            value=value,
            low=min(uncorrected, fully_corrected),
            high=max(uncorrected, fully_corrected),
            unit=MEASURED[SHARED_PIXELS],
        )
    }


def _select_closing(
    observations: Sequence[Observation], *, until_s: float
) -> Sequence[Observation]:
    """Return the observations up to the maximum finger pressure before a time."""
    pressure_kpa = [one.gripper.pressure_kpa for one in observations if one.frame.time_s <= until_s]
    return observations[: int(np.nanargmax(pressure_kpa)) + 1]


def _sharing_exponent(
    closing: Sequence[Observation], *, held: FloatArray, layout: ArrayLayout
) -> float:
    """Return the force exponent of load sharing over the last half of the load.

    The exponent is 0 if the load at the half-load time is zero or not below the final load.
    """
    light = np.flatnonzero(
        _total_load(_change_percent(closing, layout=layout)) < _EARLIER_LOAD * _total_load(held)
    )
    if not light.size:
        return 0.0
    half_load_s = closing[int(light[-1])].frame.time_s
    earlier = mean_percent_before(half_load_s, observations=closing, layout=layout)
    before, after = minus_log_sharing(earlier), minus_log_sharing(held)
    light_load, load = float(_total_load(earlier)), float(_total_load(held))
    if before is None or after is None or not 0.0 < light_load < load:
        return 0.0
    exponent = _EXCESS_POWER * (before - after) / math.log(load / light_load)
    return min(max(exponent, 0.0), _RADIUS_POWER)


def _change_percent(observations: Sequence[Observation], *, layout: ArrayLayout) -> FloatArray:
    """Return each pixel's relative change in every frame, shape (frames, rows, cols)."""
    frames = FrameColumns.from_frames([one.frame for one in observations])
    ohm = frames.ohm(layout=layout)
    at_rest = frames.time_s < frames.time_s[0] + MEAN_S
    return SampleReader(layout, ohm[at_rest].mean(axis=0)).read_ohm(ohm).change_percent


def _total_load(percent: FloatArray) -> FloatArray:
    """Return the excess conductance summed over pixels."""
    return total_excess(excess_of_change(percent))
