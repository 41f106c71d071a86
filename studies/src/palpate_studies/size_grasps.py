"""Strawberries sized on the twin by the paper's Figure 13, and by a grasp of palpate.

The readings of that grasp at its last steps are the inputs of the trees.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.compliance import Compliance
from palpate.estimate.measurement import Measurement
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.planning import DWELL_S, plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import Calibration
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import (
    CONTACT_PERCENT,
    excess_conductance,
    finger_means,
    largest_change,
    mean_change,
    relative_change_percent,
    total_excess,
)
from palpate.twin.devices import TwinArray
from palpate.twin.objects import TwinObject, draw_object
from palpate_studies.baselines.told_everything import TREES, left_out
from palpate_studies.stoppable import uninterrupted
from palpate_studies.twin_session import Session

#: Stops that are shown, up to the narrowest, and the time before each next movement that is read.
_STOPS, _READ_S = 5, 0.2
#: The fingers begin here, open beyond the largest strawberry, and close by this much at a time.
START_MM, STEP_MM = 46.0, 1.0
#: The paper gives no waiting time after a step: ours, in which the spike of the movement fades.
WAIT_S, READ_S = DWELL_S - 0.2, 0.2
STILL_S = 1.0
#: Ours without a step finer than the paper's, and with no more of them than it takes.
SAME_STEPS: dict[str, Any] = {"fine_step": STEP_MM, "smallest_step": STEP_MM, "fewest_steps": 2}


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Sized:
    """One strawberry: its size, the estimate of each way, and what our grasp did to it.

    Attributes
    ----------
    sensor : int
        Seed.
    true_mm : float
        Its extent along the closing axis.
    published_mm : float
        The previous width, as in the paper's Figure 13; NaN where contact was never seen.
    same_steps : Measurement or None
        palpate's estimate from closing in the paper's steps.
    damaged : bool
        Whether that grasp pressed it beyond its yield force.
    pressed_to_mm : float
        Least width of the grasp that gave `same_steps`.
    steps : ndarray, shape (numbers,)
        What that grasp read at its last steps (`last_steps`), for the trees.
    """

    sensor: int
    true_mm: float
    published_mm: float
    same_steps: Measurement | None
    damaged: bool
    pressed_to_mm: float
    steps: FloatArray


def sized(level: str, *, sensors: Sequence[int], berries: int) -> Iterator[Sized]:
    """Size `berries` strawberries on each sensor of a level, each in both ways."""
    for sensor in sensors:
        calibration = calibrate_twin(seed=sensor, level=level, apart_from="strawberry")
        for berry in range(berries):
            obj = draw_object(np.random.default_rng([sensor, berry, 31]), "strawberry")
            yield _sized(obj, level=level, sensor=sensor, berry=berry, calibration=calibration)


def _sized(
    obj: TwinObject, *, level: str, sensor: int, berry: int, calibration: Calibration
) -> Sized:
    coarse = _faced(obj, level, sensor, berry)
    plan = replace(plan_grasp(calibration, gripper=coarse.gripper), **SAME_STEPS)
    seen = list[Observation]()
    same_steps = _grasped(coarse, plan, seen)
    # Driven by width: the calibration always knows how the fingers give way.
    assert plan.give is not None
    return Sized(
        sensor=sensor,
        true_mm=obj.size_mm,
        published_mm=previous_width_mm(_faced(obj, level, sensor, berry)),
        same_steps=same_steps,
        damaged=coarse.world.truth().damaged,
        pressed_to_mm=narrowest_mm(seen),
        steps=last_steps(seen, plan=plan, give=plan.give),
    )


def _faced(obj: TwinObject, level: str, sensor: int, berry: int) -> Session:
    """Return a sensor and gripper with the strawberry between its fingers, not touched yet."""
    session = Session(sensor, level=level, trial=berry)
    session.close_to(START_MM)
    session.world.clock.sleep_s(STILL_S)
    session.world.place(obj)
    return session


def previous_width_mm(session: Session) -> float:
    """Close as in Figure 13 until all pixels' mean has fallen by 10 %; return the width before."""
    rest_ohm, width_mm = session.mean_ohm(), START_MM
    while width_mm > session.gripper.limits.lowest:
        before_mm, width_mm = width_mm, width_mm - STEP_MM
        session.close_to(width_mm)
        session.world.clock.sleep_s(WAIT_S)
        change = relative_change_percent(session.read(READ_S), rest_ohm=rest_ohm)
        if float(np.mean(mean_change(change))) <= CONTACT_PERCENT:
            return before_mm
    return float("nan")


def _grasped(session: Session, plan: Plan, seen: list[Observation]) -> Measurement | None:
    """Grasp what it faces and return the size that was found; `seen` gathers the readings."""
    result = uninterrupted(
        run_grasp(
            plan,
            array=TwinArray(session.world),
            gripper=session.gripper,
            clock=session.world.clock,
            subscribers=[seen.append],
        )
    )
    return result.size_mm


def deeper_mm(found: Sequence[Sized]) -> float | None:
    """Return how much further than the paper's way `same_steps` pressed, mm, in the median."""
    # The paper's way stops at the width where it sees the contact, one step within its answer.
    seen = [one for one in found if np.isfinite(one.published_mm)]
    further = [one.published_mm - STEP_MM - one.pressed_to_mm for one in seen]
    return float(np.median(further)) if further else None


def errors_mm(found: Sequence[Sized], way: str) -> FloatArray:
    """Return estimate minus size of those that have one, shape (n,)."""
    if way == TREES:
        return _learned_errors_mm(found)
    if way in ("published", "without_bias"):
        seen = [one for one in found if np.isfinite(one.published_mm)]
        errors = np.array([one.published_mm - one.true_mm for one in seen], dtype=float)
        return errors if way == "published" else _without_bias(errors, [one.sensor for one in seen])
    return np.array([m.middle - true_mm for m, true_mm in measured(found)], dtype=float)


def _without_bias(error_mm: FloatArray, sensors: Sequence[int]) -> FloatArray:
    """Return errors less the mean error on the other sensors, shape (n,); NaN with no other.

    Ten fruits sized with a caliper on other sensors give that constant.
    """
    of, found = np.array(sensors), np.full(error_mm.shape, np.nan)
    for sensor in set(sensors):
        if (of != sensor).any():
            found[of == sensor] = error_mm[of == sensor] - error_mm[of != sensor].mean()
    return found


def _learned_errors_mm(found: Sequence[Sized]) -> FloatArray:
    """Return the errors of trees that learned on all other sensors; NaN with no other."""
    true_mm = np.array([one.true_mm for one in found])
    pressed_to_mm = np.array([one.pressed_to_mm for one in found])
    thinner_mm = left_out(
        np.array([one.steps for one in found]),
        asked=true_mm - pressed_to_mm,
        specimens=[str(one.sensor) for one in found],
    )
    return np.asarray(pressed_to_mm + thinner_mm - true_mm)


def measured(found: Sequence[Sized]) -> list[tuple[Measurement, float]]:
    """Return each estimate of palpate with the true size."""
    return [(one.same_steps, one.true_mm) for one in found if one.same_steps is not None]
