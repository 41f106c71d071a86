"""What a grasp of ours read at its last steps, as numbers for a learner of the size."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.compliance import Compliance
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import (
    excess_conductance,
    finger_means,
    largest_change,
    mean_change,
    relative_change_percent,
    total_excess,
)

#: Stops that are shown, up to the narrowest, and the time before each next movement that is read.
_STOPS, _READ_S = 5, 0.2


def narrowest_mm(observations: Sequence[Observation]) -> float:
    """Return the least width at which the fingers stood still."""
    return min(stop[-1].gripper.width_mm for stop in _stops(observations))


def last_steps(observations: Sequence[Observation], *, plan: Plan, give: Compliance) -> FloatArray:
    """Return the numbers of the last stops, the narrowest last; shape (1 + 9 * stops,).

    After the width of the narrowest, for each: how much wider it is, the force by the calibrated
    law of early readings and how far the fingers give way under it, excess conductance, changes
    of all pixels, of the finger that feels less and of the strongest pixel, servo current, and the
    strongest current of the movement that led there. Stops that a short grasp lacks are those of
    the open hand.
    """
    stops = _stops(observations)
    rest_ohm = _ohm(stops[0], plan)
    widths_mm = [stop[-1].gripper.width_mm for stop in stops]
    last = int(np.argmin(widths_mm))
    rows = []
    for index in range(last - _STOPS + 1, last + 1):
        stop = stops[max(index, 0)]
        ohm = _ohm(stop, plan)
        change = relative_change_percent(ohm, rest_ohm=rest_ohm)
        excess = excess_conductance(ohm, rest_ohm=rest_ohm)
        force_n = float(plan.early_law.force_n(plan.reading.reading(excess)).value)
        fingers = finger_means(change, finger_of_row=plan.layout.finger_of_row)
        rows.append(
            (
                stop[-1].gripper.width_mm - widths_mm[last],
                force_n,
                float(give.give_mm(force_n)),
                float(np.log1p(max(float(total_excess(excess)), 0.0))),
                float(mean_change(change)),
                float(np.max(fingers)),
                float(largest_change(change)),
                stop[-1].gripper.current_ma,
                _pull_ma(observations, before_s=stop[0].frame.time_s),
            )
        )
    return np.array([widths_mm[last], *np.ravel(rows)])


def _stops(observations: Sequence[Observation]) -> list[list[Observation]]:
    """Return the observations of each time that the fingers stood still."""
    grouped = groupby(observations, key=lambda one: one.gripper.moving)
    return [list(stop) for moving, stop in grouped if not moving]


def _ohm(stop: Sequence[Observation], plan: Plan) -> FloatArray:
    """Return the mean of the last frames of a stop, shape (rows, cols)."""
    since_s = stop[-1].frame.time_s - _READ_S
    frames = [one.frame for one in stop if one.frame.time_s >= since_s]
    ohm = [
        pixel_resistance_ohm(one.counts, layout=plan.layout, oversampling=one.oversampling)
        for one in frames
    ]
    return np.asarray(np.maximum(np.mean(ohm, axis=0), plan.layout.divider.least_ohm))


def _pull_ma(observations: Sequence[Observation], *, before_s: float) -> float:
    """Return the strongest servo current of the last movement before a time; 0 with none."""
    before = [one for one in observations if one.frame.time_s < before_s]
    pulls = list[float]()
    for one in reversed(before):
        if not one.gripper.moving:
            break
        pulls.append(one.gripper.current_ma)
    return max(pulls, default=0.0)
