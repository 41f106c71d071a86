"""The grip as the gripper itself measures it, in addition to the sheet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.closing_stiffness import LAG, tilt_sd, unforgotten
from palpate.estimate.gain import Gain, MeasuredForce

if TYPE_CHECKING:
    from palpate.grasp.belief import Belief
    from palpate.grasp.plan import Plan
    from palpate.gripper.interface import GripperState


#: A grasp loads the sheet in a few large steps, the calibration in many small ones: read soon
#: after a step, the sheet lags by another amount than it was calibrated with (log sd).
_HASTE_SD = 0.12
#: Below this force, newtons, the sheet's rise is not used.
_FAINTEST_N = 0.05


#: Less than this share of the strongest reading of the closing is a different grip from the one
#: that the servo's current was read in.
_LEFT_SHARE = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Pull:
    """Servo current at one moment of the closing movement that began at `moved_s`."""

    closure: float
    current_ma: float
    moved_s: float


def pulled(belief: Belief, gripper: GripperState, plan: Plan) -> tuple[Pull, ...]:
    """Return the readings of the closing so far, with this one if it is of a movement of it."""
    closure = plan.gripper.closure(gripper)
    closing = gripper.moving and closure < belief.sent and belief.contact_s is not None
    if not closing or math.isnan(gripper.current_ma):
        return belief.pulls
    pull = Pull(closure=closure, current_ma=gripper.current_ma, moved_s=belief.moved_s)
    return (*belief.pulls, pull)


def felt_by_gripper(belief: Belief, plan: Plan) -> MeasuredForce | None:
    """Return the force at the present closure as the gripper itself measures it, if it can."""
    if plan.current is None or not belief.pulls or not belief.staircase:
        return None
    closure = np.array([stair.closure for stair in belief.staircase])
    reading = np.array([stair.touch.reading for stair in belief.staircase])
    force_n = _caught_up(plan.early_law.force_n(reading).value, plan)
    at = np.array([belief.closure, *(pull.closure for pull in belief.pulls)])
    sheet_n = _between(at, closure, force_n)
    if not sheet_n[0] > _LEFT_SHARE * sheet_n.max():
        return None
    return plan.current.measured(
        [pull.current_ma for pull in belief.pulls],
        share=sheet_n[1:] / sheet_n[0],
        width_mm=[plan.gripper.target(pull.closure) for pull in belief.pulls],
        movement=[pull.moved_s for pull in belief.pulls],
        tilt_sd=tilt_sd(plan.early_law.residual_sd),
    )


def _caught_up(force_n: FloatArray, plan: Plan) -> FloatArray:
    """Return the sheet's forces of the steps of a closing with its lag taken out."""
    nothing = plan.early_law.force_n(0.0, level=plan.level)
    rising = unforgotten(force_n, faint_n=max(float(nothing.high), _FAINTEST_N))
    return np.asarray(force_n * np.exp(LAG * rising))


def _between(at: FloatArray, closure: FloatArray, force_n: FloatArray) -> FloatArray:
    """Return the sheet's force at closures between its steps, and beyond the last one."""
    found = np.interp(at, closure, force_n)
    if closure.size > 1:
        # Corrections go beyond the staircase: there the force goes on as its last steps did.
        slope = max(force_n[-1] - force_n[-2], 0.0) / (closure[-1] - closure[-2])
        found += slope * np.maximum(at - closure[-1], 0.0)
    return np.asarray(found)


def early_gain(belief: Belief, plan: Plan) -> Gain:
    """Return how this contact reads, soon after a step, against the sheet's early law."""
    gain = Gain.unknown(law_sd=plan.early_law.residual_sd, more_sd=_HASTE_SD)
    felt = felt_by_gripper(belief, plan)
    if felt is None:
        return gain
    sheet_n = float(plan.early_law.force_n(belief.staircase[-1].touch.reading).value)
    return gain.updated(felt, sheet_n=sheet_n)
