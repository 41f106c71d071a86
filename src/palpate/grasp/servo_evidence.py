"""Grip force measured by the gripper itself, in addition to the sheet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from palpate.arrays import FloatArray
from palpate.force.gain import Gain, MeasuredForce
from palpate.grasp.config import GUARDS, SETTLE, SQUEEZE
from palpate.object.closing_curve import tilt_sd

if TYPE_CHECKING:
    from palpate.grasp.estimator import ContactEstimate
    from palpate.grasp.plan import Plan
    from palpate.object.compliance import SoftFingerCompliance


#: Fewest steps with contact to locate its start, and the largest force of the search, newtons.
_FEWEST_TOUCHED, _MOST_N = 2, 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentSample:
    """Servo current at one moment of the closing movement that started at `moved_s`."""

    closure: float
    current_ma: float
    moved_s: float


def gripper_force(estimate: ContactEstimate, plan: Plan) -> MeasuredForce | None:
    """Measure the force at the present closure with the gripper, if it can."""
    if plan.bend is not None:
        return _force_from_pressure(estimate, plan, plan.bend)
    if plan.current is None or not estimate.current_samples or not estimate.steps:
        return None
    closure = np.array([step.closure for step in estimate.steps])
    force_n = np.array([step.touch.sheet_n for step in estimate.steps])
    at = np.array([estimate.closure, *(pull.closure for pull in estimate.current_samples)])
    sheet_n = _interpolate_force(at, closure, force_n)
    if not sheet_n[0] > GUARDS.lost_fraction * sheet_n.max():
        return None
    return plan.current.measure(
        [pull.current_ma for pull in estimate.current_samples],
        fraction=sheet_n[1:] / sheet_n[0],
        width_mm=[plan.gripper.target(pull.closure) for pull in estimate.current_samples],
        movement=[pull.moved_s for pull in estimate.current_samples],
        tilt_sd=tilt_sd(estimate.steps[-1].touch.log_sd),
    )


def _force_from_pressure(
    estimate: ContactEstimate, plan: Plan, bend: SoftFingerCompliance
) -> MeasuredForce | None:
    """Measure the force of pressure-driven fingers from their deflection.

    The fingers deflect far more than the object, so the force follows from the closing since
    contact. Contact is between the last step without contact and the zero of the sheet's
    extrapolated force, which does not depend on the sheet's gain.
    """
    force_n = np.array([step.touch.sheet_n for step in estimate.steps])
    weaker = np.array([step.touch.weakest_percent for step in estimate.steps])
    closure = np.array([step.closure for step in estimate.steps])
    touched = weaker <= plan.hint_percent
    if np.count_nonzero(touched) < _FEWEST_TOUCHED or not force_n[-1] > 0:
        return None
    first = int(np.argmax(touched))
    slope, offset = np.polyfit(closure[touched], force_n[touched], 1)
    free = closure[first - 1] if first > 0 else closure[first] - plan.step
    start = min(float(-offset / slope), closure[first]) if slope > 0 else free
    travel_mm = bend.mm_per_kpa * (estimate.closure - start)
    # Stiff fingers can't measure force: no force of the search deflects them this far.
    if not 0.0 < travel_mm < float(bend.compliance.deflection_mm(_MOST_N)):
        return None
    low_n, high_n = (
        brentq(
            lambda f, per_n=per_n: bend.compliance.deflection_mm(f) + f * per_n - travel_mm,
            0.0,
            _MOST_N,
        )
        for per_n in (1.0 / SQUEEZE.soft_n_per_mm, 0.0)
    )
    middle_n = math.sqrt(low_n * high_n)
    start_sd_mm = bend.mm_per_kpa * max(closure[first] - free, plan.fine_step) / math.sqrt(12.0)
    return MeasuredForce(
        force_n=middle_n,
        sd_n=middle_n / travel_mm * start_sd_mm,
        log_sd=math.hypot(SETTLE.hysteresis_sd, math.log(high_n / low_n) / math.sqrt(12.0)),
    )


def _interpolate_force(at: FloatArray, closure: FloatArray, force_n: FloatArray) -> FloatArray:
    """Interpolate the sheet's force between its steps, and extrapolate beyond the last."""
    found = np.interp(at, closure, force_n)
    if closure.size > 1:
        # Corrections close beyond the last step: the force continues with the last slope.
        slope = max(force_n[-1] - force_n[-2], 0.0) / (closure[-1] - closure[-2])
        found += slope * np.maximum(at - closure[-1], 0.0)
    return np.asarray(found)


def measure_gain(estimate: ContactEstimate, plan: Plan, *, prior: Gain) -> Gain:
    """Return the gain of this contact relative to the sheet's law, at the last step.

    `prior`: without a measurement by the gripper.
    """
    last = estimate.steps[-1].touch
    measured = gripper_force(estimate, plan)
    return prior if measured is None else prior.update(measured, sheet_n=last.sheet_n)
