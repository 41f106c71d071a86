"""Settle phase: predict the settled force, and correct it up or down."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

from palpate.grasp.answers import forecast, measure_object, measure_stiffness, read_force
from palpate.grasp.config import SETTLE, SQUEEZE
from palpate.grasp.estimator import ContactEstimate
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.safety_filter import filter_command, quantize_target
from palpate.grasp.state import GraspState
from palpate.grasp.step_size import close_by, deformation_mm, force_now, record_step, slope_n
from palpate.gripper.interface import GripperCommand
from palpate.measurement import Measurement


def settle(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Wait until the settled force is known, then correct it."""
    return _ACTIVITIES[state.correction.activity](state, plan)


def await_forecast(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Wait until the hand is quiet, then measure the settled force and the object."""
    estimate, correction = state.estimate, state.correction
    if estimate.still_s >= plan.dwell_s and correction.count:
        record_step(estimate, plan)
    if estimate.still_s < SETTLE.decide_after_s:
        return None
    force = state.set_settled_force(forecast(estimate, plan=plan), plan=plan)
    _record_on_target(state, force, plan)
    assert correction.present is not None
    found = measure_object(estimate, correction.present, plan=plan)
    state.result = replace(state.result, **found)
    state.enter(Activity.ADJUST)
    return None


def adjust(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Correct the settled force, up or down, until it is within the target's tolerance."""
    correction, force, present = state.correction, state.result.force_n, state.correction.present
    assert force is not None
    assert present is not None
    limited = _is_limited(state.estimate, force, plan)
    below = is_below_target(force, plan)
    if correction.count < SETTLE.most_adjustments:
        # At a damage limit, one correction uses all of the allowed force.
        if below and not (limited and correction.count):
            command = increase_force(state, present, plan, by_n=force_deficit_n(force, plan))
            if command is not None:
                state.enter(Activity.FORECAST, event="adjusted")
                return command
        elif is_above_target(force, plan):
            goal_now_n = goal_n(plan) * present.middle / force.middle
            command = reduce_force(state, present, plan, to_n=goal_now_n)
            state.enter(Activity.EASE, event="eased")
            return command
    if limited and below:
        state.record_event("damage_limit")
    if not is_lift_certain(force, plan):
        return state.release(plan, Outcome.TOO_WEAK)
    state.enter(Phase.HOLD, event="answer")
    return None


def ease(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Close again from below to the closure of the target force."""
    if state.estimate.still_s < plan.confirm_s:
        return None
    request = return_from_below(state, plan)
    command = filter_command(request, state.estimate, plan)
    if request is None or command is None or command.target == request.target:
        state.enter(Activity.FORECAST, event="adjusted")
    return request


_ACTIVITIES = {Activity.FORECAST: await_forecast, Activity.ADJUST: adjust, Activity.EASE: ease}


# -- target force ----------------------------------------------------------------------------------


def goal_n(plan: Plan) -> float:
    """Return the target force of the plan."""
    target_n = plan.gentle_force_n if plan.target_force_n is None else plan.target_force_n
    return max(target_n, plan.lift_force_n or 0.0)


def gentle_goal(estimate: ContactEstimate, plan: Plan) -> tuple[float, str]:
    """Return the force that ends a squeeze without target, newtons, and the reason.

    The squeeze ends at the deformation that every recorded fruit withstood. A firm object is
    squeezed harder, until its stiffness is known or its largest allowed deformation is reached.
    """
    goal = goal_n(plan)
    if plan.lift_force_n is not None:
        return goal, "force_reached"
    if deformation_mm(estimate, plan) >= plan.gentle_mm:
        return 0.0, "gave_way"
    if plan.gripper.drive == "pressure":
        # Soft fingers can't measure the object's deformation, so more force adds no information.
        return 0.5 * goal, "force_reached"
    if estimate.force_n < goal:
        return goal, "force_reached"
    stiffness = measure_stiffness(estimate, force_now(estimate, plan), plan=plan)
    if stiffness is None:
        return goal, "force_reached"
    widest = (1.0 + SQUEEZE.stiffness_tolerance) / (1.0 - SQUEEZE.stiffness_tolerance)
    # A stiffness above the range that needs a firmer squeeze counts as known.
    if stiffness.high / stiffness.low <= widest or stiffness.low > SQUEEZE.firm_n_per_mm:
        return goal, "stiffness_known"
    return max(goal, min(plan.firm_force_n, SQUEEZE.firm_mm * stiffness.low)), "firm_enough"


def force_deficit_n(force: Measurement, plan: Plan) -> float:
    """Return the additional force needed to reach the target and ensure the lift."""
    of_target_n = 0.0 if plan.target_force_n is None else plan.target_force_n - force.middle
    if plan.lift_force_n is None:
        return of_target_n
    return max(of_target_n, plan.lift_force_n - force.low)


def _has_force_deficit(force: Measurement, plan: Plan) -> bool:
    return force_deficit_n(force, plan) > SETTLE.target_tolerance * goal_n(plan)


def is_below_target(force: Measurement, plan: Plan) -> bool:
    """Whether a settled force is too small for the target or to ensure the lift."""
    return _has_force_deficit(force, plan) or not is_lift_certain(force, plan)


def is_above_target(force: Measurement, plan: Plan) -> bool:
    """Whether a settled force exceeds the tolerance above the target and may be reduced."""
    if plan.target_force_n is None:
        return False
    wanted_n = goal_n(plan)
    low_n = force.low * wanted_n / max(force.middle, wanted_n)
    can_lift = plan.lift_force_n is None or low_n >= plan.lift_force_n
    return can_lift and force.middle > (1.0 + SETTLE.target_tolerance) * wanted_n


def is_lift_certain(force: Measurement, plan: Plan) -> bool:
    """Whether a settled force is certain to lift the object, if a lift is planned."""
    return plan.lift_force_n is None or force.low >= plan.lift_force_n


def _is_limited(estimate: ContactEstimate, force: Measurement, plan: Plan) -> bool:
    """Whether the damage limit prevents part of the required force increase."""
    if plan.damage is None:
        return False
    if math.isinf(estimate.damage_low_n):
        # With an unknown limit no additional force is allowed.
        return True
    lowest = estimate.damage_low_n < plan.safety.force_ceiling_n
    return lowest and force_deficit_n(force, plan) > estimate.damage_low_n - force.high


def _record_on_target(state: GraspState, force: Measurement, plan: Plan) -> None:
    """Record the first time after a movement at which the settled force is on target."""
    moved_s = state.estimate.moved_s
    known = any(m.name == "on_target" and m.time_s > moved_s for m in state.result.moments)
    off = _has_force_deficit(force, plan) or is_above_target(force, plan)
    if plan.target_force_n is not None and not known and not off:
        state.record_event("on_target")


# -- corrections -----------------------------------------------------------------------------------


def increase_force(
    state: GraspState, force: Measurement, plan: Plan, *, by_n: float
) -> GripperCommand | None:
    """Return the closing command for a force increase; None if no step is safe."""
    correction, trial = state.correction, copy(state.estimate)
    slope, longest = slope_n(trial, plan), math.inf
    # This force includes the gripper's own measurement.
    trial.set_force(force.middle, force.high)
    if correction.before is not None:
        closure, force_n = correction.before
        travel = trial.closure - closure
        if travel > 0:
            # The slope of weak steps may be far too steep: use that of the last correction, within
            # a limit. A correction without effect limits the next step to its own travel.
            measured = max((force.middle - force_n) / travel, slope / SETTLE.max_slope_drop)
            slope = min(slope, measured)
            longest = math.inf if force.middle > force_n else travel
    step = max(min(by_n / slope, longest), plan.smallest_step)
    command = close_by(trial, step, plan, min_duration_s=SETTLE.correction_s)
    if command is not None:
        state.estimate = trial
        correction.count += 1
        correction.before = (trial.closure, trial.force_n)
    return command


def reduce_force(
    state: GraspState, force: Measurement, plan: Plan, *, to_n: float
) -> GripperCommand:
    """Return the command that opens to well below the target force, before closing again.

    Neither the sheet's response to unloading nor the backlash of the gears is calibrated.
    """
    estimate, correction = state.estimate, state.correction
    estimate.set_force(force.middle, force.high)
    slope, excess_n = slope_n(estimate, plan), estimate.force_n - to_n
    closure = estimate.closure - max(excess_n / slope, plan.smallest_step)
    opened = max(closure - SETTLE.easing_fraction * to_n / slope - SETTLE.backlash, 0.0)
    fraction = (1.0 - SETTLE.easing_fraction) * to_n / estimate.force_n
    estimate.set_force(fraction * estimate.force_n, fraction * estimate.force_high_n)
    correction.return_closure = closure
    correction.count += 1
    return GripperCommand(target=quantize_target(opened, plan), rate=plan.squeeze_rate)


def return_from_below(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Return the command that closes again from below, as in the sheet's calibration.

    The safety filter may divide it into several movements. The sheet retains part of the earlier
    load, so its reading is an upper bound of the force.
    """
    estimate, closure = state.estimate, state.correction.return_closure
    assert closure is not None
    travel = closure - estimate.closure
    if travel < plan.smallest_step or not estimate.touches:
        return None
    read = read_force(estimate.now, estimate.gain, plan)
    estimate.set_force(read.middle, read.high)
    return GripperCommand(target=quantize_target(closure, plan), rate=travel / SETTLE.correction_s)
