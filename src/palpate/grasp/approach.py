"""Approach phase: closing at speed until contact, then in fine steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from palpate.force.gain import Gain
from palpate.grasp.answers import read_force
from palpate.grasp.config import APPROACH, READING
from palpate.grasp.estimator import ContactEstimate, Touch, closure_of
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.rest import measure_rest, verify_rest
from palpate.grasp.result import Outcome
from palpate.grasp.safety_filter import quantize_target, safe_step, stop_here
from palpate.grasp.state import Attempt, GraspState
from palpate.grasp.step_size import (
    approach_step,
    close_by,
    record_step,
    squeeze_step,
)
from palpate.grasp.sweep import Sweep, blind_time_s
from palpate.gripper.interface import GripperCommand
from palpate.measurement import half_width_sds


def approach(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Measure the rest values, then close until both fingers are in contact."""
    return _ACTIVITIES[state.attempt.activity](state, plan)


def approach_in_steps(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Measure the rest values, then close step by step until both fingers are in contact."""
    estimate, attempt = state.estimate, state.attempt
    if estimate.rest_ohm is None:
        return _continue(state, plan) if measure_rest(state, plan=plan) else None
    if estimate.still_s < plan.dwell_s or not estimate.touches:
        return None
    if attempt.rest_check_from is not None and not verify_rest(
        state, attempt.rest_check_from, plan=plan
    ):
        return None
    before = estimate.steps[-1].closure if estimate.steps else None
    record_step(estimate, plan)
    if estimate.now.weakest_percent <= plan.epsilon_percent or _has_grip_force(estimate, plan):
        if plan.gripper.drive == "width" and before is not None:
            width_mm = plan.gripper.target(before)
            state.result = replace(state.result, previous_width_mm=width_mm)
        if estimate.contact_s is None:
            estimate.contact_s = estimate.moved_s
        state.enter(Activity.CONFIRM)
        return None
    if estimate.closure >= plan.gripper.span - 2 * plan.smallest_step:
        return end_attempt(state, plan)
    if estimate.now.weakest_percent > plan.hint_percent:
        estimate.contact_s = None
        command = _continue(state, plan)
    else:
        if estimate.contact_s is None:
            estimate.contact_s = estimate.moved_s
        command = close_by(estimate, squeeze_step(estimate, plan, goal_n=0.0), plan)
    if command is not None or attempt.activity is Activity.SWEEP:
        return command
    if estimate.force_high_n >= plan.safety.force_ceiling_n:
        return abort_insensitive(state, plan)
    # The touch is too weak for a contact and no larger force is safe: measure at this force.
    if estimate.contact_s is None:
        estimate.contact_s = estimate.moved_s
    state.enter(Phase.SETTLE, event="contact")
    return None


def _continue(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Continue closing: in fine steps near a possible contact, otherwise at speed."""
    estimate, attempt = state.estimate, state.attempt
    touching = bool(estimate.touches) and estimate.now.strongest_percent <= READING.contact_percent
    # A weak object may not withstand another full step; its damage limit is not known yet.
    if attempt.rest_check_from is not None or (plan.damage is not None and touching):
        return close_by(estimate, plan.fine_step, plan)
    if attempt.sweep_end is None or estimate.closure > attempt.sweep_end + approach_step(plan):
        start_sweep(state, plan)
        return None
    # One finger alone pushes the object to the middle; contact of the other finger follows.
    fraction = 1.0 if touching else 0.5
    return close_by(estimate, max(fraction * approach_step(plan), plan.fine_step), plan)


def _has_grip_force(estimate: ContactEstimate, plan: Plan) -> bool:
    """Return whether the force exceeds that of one finger pushing the object to the middle.

    A contact may read more than its sheet usually does. If one finger shows nothing, the force must
    therefore be certain.
    """
    now, certain_n = estimate.now, plan.no_push_n
    if now.weakest_percent > plan.hint_percent:
        certain_n *= math.exp(half_width_sds(plan.level) * now.log_sd)
    return estimate.force_n > certain_n


def confirm(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Confirm the contact with new frames, to exclude noise."""
    estimate = state.estimate
    # A gripper may report a movement for a moment without a command.
    if state.phase_time_s < plan.confirm_s or not estimate.touches:
        return None
    is_weak = estimate.now.strongest_percent > 0.5 * plan.epsilon_percent
    if is_weak and not _has_grip_force(estimate, plan):
        state.enter(Activity.TOUCH)
        return None
    # The end of the sweep may have recorded this contact already.
    since_s, moments = state.attempt.sweep_contact_s, state.result.moments
    known = since_s is not None and any(m.name == "contact" and m.time_s > since_s for m in moments)
    state.enter(Phase.SQUEEZE, event=None if known else "contact")
    return None


def end_attempt(state: GraspState, plan: Plan) -> GripperCommand:
    """Open the hand after an attempt without contact; end the grasp after the last attempt."""
    command = state.release(plan, Outcome.NOTHING_THERE)
    state.attempts += 1
    if state.attempts < plan.tries:
        state.attempt, state.phase = Attempt(activity=Activity.WAIT), Phase.APPROACH
    return command


def wait_for_retry(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Wait with the hand open until the next attempt, or until a finger is touched."""
    opened = state.estimate.closure <= plan.step / 2
    if not opened or state.phase_time_s < plan.dwell_s:
        return None
    touched = any(moment.name == "touch" for moment in state.result.moments[-1:])
    if state.estimate.still_s >= plan.wait_s or touched:
        state.estimate, state.attempt = state.estimate.start_attempt(), Attempt()
        state.enter(Activity.TOUCH)
    return None


def abort_insensitive(state: GraspState, plan: Plan) -> GripperCommand:
    """Open: according to the calibration, even a barely detectable force may be too high."""
    state.add_fault(
        f"according to the calibration, a light touch could be {state.estimate.force_high_n:.1f} N,"
        f" but the limit is {plan.safety.force_ceiling_n:g} N; calibrate the force again"
    )
    return state.release(plan, Outcome.FORCE_LIMIT)


# -- at speed --------------------------------------------------------------------------------------


def start_sweep(state: GraspState, plan: Plan, *, rows: tuple[int, ...] | None = None) -> None:
    """Start to close at speed, to near the expected size or the range's end.

    `rows`: pixel rows to check for contact; all by default.
    """
    estimate = state.estimate
    # The stopping delay is one frame period, the lag of the sheet, and the gripper's latency.
    late_s = estimate.period_s + READING.lag_s + plan.safety.latency_s
    overrun = APPROACH.overrun_steps * approach_step(plan)
    limits = plan.gripper
    end, rate = limits.span, min(max(overrun / late_s, limits.slowest), limits.fastest)
    # A fast sweep ends far enough before the object for contact detection to recover.
    near = _free_closure(plan) - rate * blind_time_s(estimate.period_s)
    slowed = estimate.sweep is not None
    if not slowed and near - estimate.closure > approach_step(plan):
        # The expected size may be wrong: no command exceeds the safe step for any object.
        safe = safe_step(estimate, plan)
        hasty_s = _lookahead_s(estimate, plan) + plan.safety.latency_s
        end, rate = near, max(rate, min(safe / hasty_s, plan.gripper.fastest))
    most_n = math.inf
    if rows is not None:
        # With contact at one finger, the law for two fingers reads half of the force.
        is_weak = estimate.now.strongest_percent > plan.hint_percent
        most_n = plan.no_push_n if is_weak else 0.5 * plan.no_push_n
    estimate.sweep = Sweep(
        rate=rate,
        begin=estimate.closure,
        end=end,
        since_s=estimate.now_s,
        slowed=slowed,
        rows=rows,
        most_n=most_n,
    )
    state.enter(Activity.SWEEP)


def _free_closure(plan: Plan) -> float:
    """Return the closure up to which no contact with the expected object is possible."""
    if plan.expect_size_mm is None:
        return 0.0
    width_mm = plan.expect_size_mm + APPROACH.size_error_mm
    if plan.gripper.drive == "width":
        zero_mm = 0.0 if plan.compliance is None else plan.compliance.zero_mm
        return plan.gripper.highest - (width_mm + zero_mm)
    if plan.bend is None:
        return 0.0
    return -(width_mm + plan.bend.compliance.zero_mm) / plan.bend.mm_per_kpa - plan.gripper.lowest


def continue_sweep(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Continue closing, with the target slightly ahead of the hand; stop at a contact."""
    estimate, sweep = state.estimate, state.estimate.sweep
    assert sweep is not None
    # Pixels do not change while the hand is at rest; tracking checks detect that case.
    frozen = sweep.is_frozen and estimate.still_since_s is None
    # A force above that of a push is a grip, even if the other finger does not show contact.
    gripped = estimate.confirmed_force_n > sweep.most_n
    if sweep.time_s and (frozen or gripped or sweep.is_touching(plan.current)):
        return _finish_sweep(state, stop_here(estimate, plan))
    near = sweep.end < plan.gripper.span
    ahead = sweep.rate * _lookahead_s(estimate, plan)
    if near and estimate.closure >= sweep.end - ahead:
        # Continue before the hand stops, because a stop resembles a contact.
        start_sweep(state, plan)
        return None
    if estimate.closure >= sweep.end - plan.smallest_step:
        return _finish_sweep(state, None)
    target = quantize_target(min(estimate.closure + ahead, sweep.end), plan)
    sent = estimate.sent
    further = sent is None or closure_of(target, plan) > sent + plan.resolution / 2
    # Repeat commands to a stationary hand, after the tracking check, so that it counts as idle.
    if not further and estimate.now_s - estimate.moved_s < 2 * plan.safety.arrival_s:
        return None
    return GripperCommand(target=target, rate=sweep.rate)


def _finish_sweep(state: GraspState, command: GripperCommand | None) -> GripperCommand | None:
    state.attempt.sweep_end = state.estimate.closure
    state.enter(Activity.EVALUATE)
    return command


def _lookahead_s(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the lookahead of a sweep's command, s; without further commands the hand stops."""
    return APPROACH.lookahead_frames * estimate.period_s + plan.safety.latency_s


def evaluate_contact(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Classify the end of a sweep: contact of both fingers, of one, or of none."""
    estimate, attempt = state.estimate, state.attempt
    if estimate.still_s < READING.quiet_s or not estimate.touches:
        return None
    assert estimate.sweep is not None
    now, travel = estimate.now, estimate.closure - estimate.sweep.begin
    estimate.sweep = None
    force = read_force(now, Gain(), plan)
    if now.weakest_percent > READING.contact_percent:
        pushes = now.strongest_percent <= READING.contact_percent
        alone = (
            pushes and now.weakest_percent > APPROACH.one_finger_fraction * now.strongest_percent
        )
        if alone and force.middle <= plan.no_push_n and travel > approach_step(plan):
            start_sweep(state, plan, rows=_rows_without_contact(now, plan))
            return None
        # No contact, or one finger pushing without progress: continue in small steps.
        pushed = APPROACH.most_push_steps * plan.step if pushes else 0.0
        attempt.sweep_end = estimate.closure + pushed
        state.enter(Activity.TOUCH)
        return None
    estimate.set_force(force.middle, force.high)
    if plan.law.threshold_n(level=plan.level) >= plan.safety.force_ceiling_n:
        return abort_insensitive(state, plan)
    attempt.sweep_contact_s = estimate.moved_s
    if now.weakest_percent <= plan.hint_percent or _has_grip_force(estimate, plan):
        state.record_event("contact")
    state.enter(Activity.TOUCH)
    return None


def _rows_without_contact(now: Touch, plan: Plan) -> tuple[int, ...]:
    """Return the rows of pixels on fingers without contact.

    A finger in contact is excluded: it pushes the object to the middle, so its pixels change during
    the movement.
    """
    touching = np.array(now.finger_percent) <= READING.contact_percent
    return tuple(np.flatnonzero(~touching[list(plan.layout.finger_of_row)]).tolist())


_ACTIVITIES = {
    Activity.TOUCH: approach_in_steps,
    Activity.SWEEP: continue_sweep,
    Activity.EVALUATE: evaluate_contact,
    Activity.CONFIRM: confirm,
    Activity.WAIT: wait_for_retry,
}
