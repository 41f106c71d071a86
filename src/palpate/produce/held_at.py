"""Where the hand stood when a grasp gave its answer: its width or its pressure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimate.measurement import Measurement
from palpate.grasp.belief import Observation
from palpate.grasp.result import GraspResult
from palpate.produce.felt_pixels import MEAN_S, answered_s
from palpate.produce.records import MEASURED, Drive

#: Name of the measurement by what drives the hand.
HELD_AT: dict[Drive, str] = {"width": "width_mm", "pressure": "pressure_kpa"}


def held_at(
    observations: Sequence[Observation], *, result: GraspResult, drive: Drive
) -> dict[str, Measurement]:
    """Return width (mm) or pressure (kPa) at the answer, by its name; nothing if there was none.

    It is what the gripper reports, with its own zero, over the same moments as the pixels; the
    interval holds all of these reports. One hand meets one object at one place of its way, so the
    place tells how much force there is, whatever the sheet says of it.

    Parameters
    ----------
    observations : sequence of Observation
        Of the whole grasp, as `run_grasp` tells its subscribers.
    result : GraspResult
        Of that grasp.
    drive : {"width", "pressure"}
        What the gripper is driven by.
    """
    name, until_s = HELD_AT[drive], answered_s(result)
    if until_s is None:
        return {}
    reported = [
        getattr(one.gripper, name)
        for one in observations
        if until_s - MEAN_S < one.frame.time_s <= until_s
    ]
    if not reported or not np.isfinite(reported).all():
        return {}
    return {
        name: Measurement(
            value=float(np.mean(reported)),
            low=min(reported),
            high=max(reported),
            unit=MEASURED[name],
        )
    }
