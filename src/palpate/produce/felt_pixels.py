"""What each pixel felt when a grasp gave its answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.grasp.belief import Observation
from palpate.grasp.result import GraspResult
from palpate.produce.records import PixelPercent
from palpate.sensor.array import ArrayLayout
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import relative_change_percent

#: Readings are means over so long: before the first movement, and before the answer.
MEAN_S = 0.4


def felt_pixels(
    observations: Sequence[Observation], *, result: GraspResult, layout: ArrayLayout
) -> PixelPercent | None:
    """Return each pixel's relative change when the answer was given; None if there was none.

    Parameters
    ----------
    observations : sequence of Observation
        Of the whole grasp, as `run_grasp` tells its subscribers.
    result : GraspResult
        Of that grasp.
    layout : ArrayLayout
        Of its frames.
    """
    answered = [moment.time_s for moment in result.moments if moment.name == "answer"]
    if not answered or not observations:
        return None
    began_s = observations[0].frame.time_s
    rest = _mean_ohm(observations, began_s - 1e-9, began_s + MEAN_S, layout=layout)
    held = _mean_ohm(observations, answered[-1] - MEAN_S, answered[-1], layout=layout)
    percent = relative_change_percent(held, rest_ohm=rest)
    return tuple(
        tuple(float(one) if np.isfinite(one) else None for one in row) for row in percent.tolist()
    )


def _mean_ohm(
    observations: Sequence[Observation], after_s: float, until_s: float, *, layout: ArrayLayout
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    ohm = [
        pixel_resistance_ohm(one.frame.counts, layout=layout, oversampling=one.frame.oversampling)
        for one in observations
        if after_s < one.frame.time_s <= until_s
    ]
    return np.asarray(np.mean(ohm, axis=0))
