"""Safety filter for all commands: limits each closing step, from the last observed position."""

from __future__ import annotations

import math

import numpy as np

from palpate.grasp.answers import mm_per_unit, sheet_forces_n
from palpate.grasp.config import READING, SQUEEZE
from palpate.grasp.estimator import ContactEstimate, closure_of
from palpate.grasp.plan import Plan
from palpate.grasp.safety import largest_step
from palpate.gripper.interface import GripperCommand
from palpate.object.closing_curve import CONTACT_SD

#: Tolerance for rounding errors, mm or kPa, or steps of a drive.
_EXACT = 1e-9


def filter_command(
    request: GripperCommand | None, estimate: ContactEstimate, plan: Plan
) -> GripperCommand | None:
    """Limit a command to the safe closing; None for no movement.

    With the latency t of the hand, a closing command of step s and speed v satisfies

        s + v t <= S,  S = (smaller of ceiling and damage limit - upper force) / upper stiffness - e

    where e is the lag of the reported behind the commanded position (`safe_step`). A shortened
    movement keeps its duration: v is the requested speed x s / requested travel, or the hand's
    slowest. Opening commands pass unchanged.
    """
    if request is None or closure_of(request.target, plan) <= estimate.closure:
        return request
    travel = min(closure_of(request.target, plan), plan.gripper.span) - estimate.closure
    if travel <= 0:
        return None
    slowest, latency_s = plan.gripper.slowest, plan.safety.latency_s
    safe, overrun = safe_step(estimate, plan), request.rate * latency_s / travel
    room = min(
        safe / (1.0 + overrun), safe - slowest * latency_s, _largest_blind_step(estimate, plan)
    )
    target = plan.gripper.target(estimate.closure + travel)
    if travel > room + _EXACT:
        target = quantize_target(estimate.closure + max(room, 0.0), plan, within=True)
    step = closure_of(target, plan) - estimate.closure
    if step < plan.smallest_step - _EXACT:
        return None
    return GripperCommand(target=target, rate=max(request.rate * min(step / travel, 1.0), slowest))


def safe_step(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the largest closing step that is safe for any object."""
    safe = largest_step(
        force_high_n=estimate.force_high_n,
        steepest_n=plan.steepest_n,
        damage_low_n=estimate.damage_low_n,
        limits=plan.safety,
    )
    return safe - estimate.tracking_lag


def _largest_blind_step(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the largest step while the damage limit is still unknown.

    The travel counts from the first force above drift, because smaller forces do not determine a
    limit. A small force on one finger pushes the object to the middle, and does not count.
    """
    if plan.damage is None or not math.isinf(estimate.damage_low_n):
        return math.inf
    force_n = sheet_forces_n(estimate.steps, estimate)
    weaker = np.array([step.touch.weakest_percent for step in estimate.steps])
    gripped = (weaker <= READING.contact_percent) | (force_n > plan.no_push_n)
    loaded = gripped & (force_n > CONTACT_SD * plan.law.weak_sd_n)
    if not loaded.any():
        return math.inf
    soft_n = SQUEEZE.soft_n_per_mm * mm_per_unit(plan)
    longest = 2 * SQUEEZE.min_rise_n * (1.0 / plan.steepest_n + 1.0 / soft_n)
    return estimate.steps[int(np.argmax(loaded))].closure + longest - estimate.closure


def quantize_target(closure: float, plan: Plan, *, within: bool = False) -> float:
    """Return the target of a closure, rounded to the drive's steps.

    Rounds to the nearest step, or towards open with `within`. Without this, the gripper would round
    the target, and a replay could not reproduce it.
    """
    steps = plan.gripper.target(closure) / plan.resolution
    if not within:
        return round(steps) * plan.resolution
    width = plan.gripper.drive == "width"
    outward = math.ceil(steps - _EXACT) if width else math.floor(steps + _EXACT)
    return outward * plan.resolution


def stop_here(estimate: ContactEstimate, plan: Plan) -> GripperCommand:
    """Return the command that stops the hand at its reported position."""
    here = quantize_target(estimate.closure - estimate.tracking_lag, plan, within=True)
    return GripperCommand(target=here, rate=plan.gripper.fastest)
