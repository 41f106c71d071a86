"""Size of the next closing step, before the safety filter."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from palpate.grasp.answers import (
    count_contact_steps,
    gain_of_law,
    measure_closing_stiffness,
    mm_per_unit,
    read_force,
    sheet_forces_n,
)
from palpate.grasp.config import READING, SQUEEZE
from palpate.grasp.estimator import ClosingStep, ContactEstimate
from palpate.grasp.plan import Plan
from palpate.grasp.safety_filter import filter_command, quantize_target
from palpate.grasp.servo_evidence import measure_gain
from palpate.gripper.interface import GripperCommand
from palpate.measurement import Measurement, half_width_sds
from palpate.object.closing_curve import CONTACT_SD


def approach_step(plan: Plan) -> float:
    """Return the step before contact that keeps a rigid object below the target force.

    With a damage model it is at most half of the plan's step: the sheet does not show weak forces,
    and a weak object may not withstand the increase of the last step. Without a target it is the
    plan's step.
    """
    if plan.target_force_n is None:
        return plan.step
    step = plan.target_force_n / plan.steepest_n
    longest = plan.step if plan.damage is None else 0.5 * plan.step
    return min(max(step, plan.fine_step), longest)


def record_step(estimate: ContactEstimate, plan: Plan) -> None:
    """Record the force, its upper bound and the damage limit once per closing step.

    One reading of each step is enough. A reading after a return to a smaller closure is ignored,
    because the closing curve is that of a first load.
    """
    touch, last = estimate.now, estimate.steps[-1] if estimate.steps else None
    if last and (estimate.moved_s < last.touch.time_s or estimate.closure <= last.closure):
        return
    estimate.steps = (*estimate.steps, ClosingStep(closure=estimate.closure, touch=touch))
    estimate.gain = measure_gain(estimate, plan, prior=gain_of_law(touch, plan))
    force = read_force(touch, estimate.gain, plan)
    estimate.set_force(force.middle, force.high)
    estimate.damage_low_n = _damage_low_n(estimate, plan)


def _damage_low_n(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the lower bound of the damage limit, from the closing so far.

    Force and limit share one gain error, so the bound is scaled to the largest gain, like the upper
    force with which it is compared.
    """
    # A limit requires two steps with certain force.
    few = count_contact_steps(estimate, plan) < 2
    if plan.damage is None or few or not estimate.force_n > 0:
        return math.inf
    stiffness = measure_closing_stiffness(estimate, force_now(estimate, plan), plan=plan)
    if stiffness is None:
        return math.inf
    half_width = half_width_sds(plan.level) * estimate.gain.log_sd
    return math.exp(half_width) * plan.damage.bound_n(stiffness, kind=plan.kind)


def force_now(estimate: ContactEstimate, plan: Plan) -> Measurement:
    """Return the force of the last closing step."""
    return Measurement(
        value=estimate.force_n,
        low=estimate.force_n**2 / estimate.force_high_n,
        high=estimate.force_high_n,
        unit="n",
        level=plan.level,
    )


def close_by(
    estimate: ContactEstimate, step: float, plan: Plan, *, min_duration_s: float = 0.0
) -> GripperCommand | None:
    """Return the command of a closing step; None if its safe part is too small.

    `min_duration_s`: shortest duration for a servo with measured current.
    """
    step = min(step, _step_to_bound(estimate, plan))
    if step < plan.smallest_step:
        return None
    rate = plan.rate if estimate.contact_s is None else plan.squeeze_rate
    if estimate.contact_s is not None and plan.current is not None:
        measured_s = max(READING.now_s, READING.fewest_frames * estimate.period_s)
        rate = min(rate, step / max(min_duration_s, measured_s))
    command = GripperCommand(target=quantize_target(estimate.closure + step, plan), rate=rate)
    return None if filter_command(command, estimate, plan) is None else command


def _step_to_bound(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the largest step that keeps the force on a rigid object near the target."""
    if plan.target_force_n is None or not estimate.force_n > 0:
        return math.inf
    target_n = max(plan.target_force_n, plan.lift_force_n or 0.0)
    room_n = SQUEEZE.max_target_ratio * target_n + SQUEEZE.max_overshoot_n - estimate.force_n
    return max(room_n, 0.0) / plan.steepest_n


def squeeze_step(estimate: ContactEstimate, plan: Plan, *, goal_n: float) -> float:
    """Return the step for the planned rise of force, larger far from the target.

    The first steps after contact are fine. Later steps are limited relative to the squeeze depth,
    because the slope of the force is known only up to that depth.
    """
    rise_n = max(plan.force_step_n, SQUEEZE.force_fraction * (goal_n - estimate.force_n))
    longest = squeeze_depth(estimate, plan) + plan.fine_step
    if plan.target_force_n is None and plan.lift_force_n is None:
        left_mm = plan.gentle_mm - deformation_mm(estimate, plan)
        longest = min(longest, max(left_mm / mm_per_unit(plan), plan.fine_step))
    wanted = max(min(rise_n / slope_high_n(estimate, plan), longest), plan.smallest_step)
    last = estimate.steps[-1]
    if estimate.moved_s > last.touch.time_s and estimate.closure <= last.closure:
        # A coarse drive rounded the last step to zero.
        wanted = max(wanted, 0.5 * plan.step)
    if plan.damage is None:
        return wanted
    if math.isinf(estimate.damage_low_n):
        # Find the limit within a small travel.
        return min(wanted, plan.fine_step)
    # Approach the limit in several steps, because each step measures it again.
    room_n = estimate.damage_low_n - estimate.force_high_n
    return min(wanted, SQUEEZE.force_fraction * room_n / slope_high_n(estimate, plan))


def squeeze_depth(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the closing travel since the object was gripped, mm or kPa.

    The start of the force is extrapolated with the slope. A light touch of one finger does not
    count, because it may only push.
    """
    force_n = sheet_forces_n(estimate.steps, estimate)
    gripped = [_is_gripped(*pair, plan) for pair in zip(estimate.steps, force_n, strict=True)]
    if not any(gripped):
        return 0.0
    first = gripped.index(True)
    travel = estimate.closure - estimate.steps[first].closure
    return float(travel + max(force_n[first], 0.0) / slope_n(estimate, plan))


def deformation_mm(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the object's deformation: squeeze depth minus the gripper's deflection."""
    depth_mm = squeeze_depth(estimate, plan) * mm_per_unit(plan)
    if plan.gripper_compliance is None:
        return depth_mm
    return depth_mm - float(plan.gripper_compliance.deflection_mm(estimate.force_n))


def slope_high_n(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the upper slope of the force: that of the last steps with stiffening."""
    return min(SQUEEZE.stiffening_ratio * slope_n(estimate, plan), plan.steepest_n)


def slope_n(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the slope of the force over the last steps, N per mm or kPa.

    Rises within the noise, or starting before the grip, are ignored. Without any slope, or with a
    force that falls during closing, the object may be rigid.
    """
    last = estimate.steps[-3:]
    curve = list(zip(last, sheet_forces_n(last, estimate).tolist(), strict=True))
    if len(curve) > 1 and plan.force_step_n < curve[-1][1] < curve[-2][1]:
        return plan.steepest_n
    slopes = [
        (f1 - f0) / (c1.closure - c0.closure)
        for (c0, f0), (c1, f1) in pairwise(curve)
        if c1.closure > c0.closure and f1 - f0 >= SQUEEZE.min_rise_n and _is_gripped(c0, f0, plan)
    ]
    found = max(slopes) if slopes else _slope_bound_n(estimate, plan)
    return float(min(found, plan.steepest_n))


def _is_gripped(step: ClosingStep, force_n: float, plan: Plan) -> bool:
    """Return whether both fingers certainly gripped at a step."""
    return step.touch.weakest_percent <= plan.hint_percent or force_n > plan.force_step_n


def _slope_bound_n(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the largest slope consistent with steps without certain rise, N per mm or kPa.

    Travel counts from the first force above drift, or from the last step at which one finger showed
    no contact, whichever is later. Until then the other finger alone pushed the object.
    """
    steps = estimate.steps
    loaded = np.flatnonzero(sheet_forces_n(steps, estimate) > CONTACT_SD * plan.law.weak_sd_n)
    one_finger = [step.touch.weakest_percent > READING.contact_percent for step in steps]
    if not loaded.size:
        return plan.steepest_n
    first = int(max([loaded[0], *np.flatnonzero(one_finger)[-1:]]))
    travel = steps[-1].closure - steps[first].closure
    if travel < plan.smallest_step:
        return plan.steepest_n
    return estimate.force_high_n / travel
