"""Change of each pixel at the time of a grasp's answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.estimator import Observation
from palpate.grasp.result import GraspResult
from palpate.sensor.array import ArrayLayout
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.sample import SampleReader
from palpate_station.records import PixelPercent

#: Averaging time at the start of the grasp and before the answer, seconds.
MEAN_S = 0.4


def answer_time_s(result: GraspResult) -> float | None:
    """Return the time of a grasp's last answer; None without an answer."""
    times_s = [moment.time_s for moment in result.moments if moment.name == "answer"]
    return times_s[-1] if times_s else None


def answer_pixel_percent(
    observations: Sequence[Observation], *, result: GraspResult, layout: ArrayLayout
) -> PixelPercent | None:
    """Return each pixel's relative change at the answer; None without an answer."""
    until_s = answer_time_s(result)
    if until_s is None or not observations:
        return None
    percent = mean_percent_before(until_s, observations=observations, layout=layout)
    return tuple(
        tuple(float(one) if np.isfinite(one) else None for one in row) for row in percent.tolist()
    )


def mean_percent_before(
    until_s: float, *, observations: Sequence[Observation], layout: ArrayLayout
) -> FloatArray:
    """Return each pixel's mean relative change just before a time, shape (rows, cols)."""
    frames = [one.frame for one in observations]
    rest = [one for one in frames if one.time_s <= frames[0].time_s + MEAN_S]
    loaded = [one for one in frames if until_s - MEAN_S < one.time_s <= until_s]
    rest_ohm, loaded_ohm = (
        FrameColumns.from_frames(part).ohm(layout=layout).mean(axis=0) for part in (rest, loaded)
    )
    return SampleReader(layout, rest_ohm).read_ohm(loaded_ohm).change_percent
