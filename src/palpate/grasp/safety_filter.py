"""The safety filter of every command: the largest closing from the reported position."""

from __future__ import annotations

import math

import numpy as np

from palpate.estimate.closing_curve import CONTACT_SD
from palpate.grasp.answers import floor_n, mm_per_unit, sheet_forces_n
from palpate.grasp.config import READING, SQUEEZE
from palpate.grasp.estimator import ContactEstimate, closure_of
from palpate.grasp.plan import Plan
from palpate.grasp.safety import largest_step
from palpate.gripper.interface import GripperCommand

#: Steps that differ by less, mm or kPa (or whole steps of a drive), differ by arithmetic only.
_EXACT = 1e-9


def filter_command(
    wish: GripperCommand | None, estimate: ContactEstimate, plan: Plan
) -> GripperCommand | None:
    """Return the safe part of a command; None for no movement.

    An opening is never cut.

    What is cut takes as long as the wish would have: it comes more slowly, and so overruns less.
    """
    if wish is None or closure_of(wish.target, plan) <= estimate.closure:
        return wish
    travel = min(closure_of(wish.target, plan), plan.gripper.span) - estimate.closure
    overrun = wish.rate * plan.safety.latency_s / travel if travel > 0 else 0.0
    room = min(safe_step(estimate, plan) / (1.0 + overrun), _largest_blind_step(estimate, plan))
    target = plan.gripper.target(estimate.closure + travel)
    if travel > room + _EXACT:
        target = quantize_target(estimate.closure + room, plan, within=True)
    cut = closure_of(target, plan) - estimate.closure
    if cut < plan.smallest_step - _EXACT:
        return None
    return GripperCommand(target=target, rate=wish.rate * min(cut / travel, 1.0))


def safe_step(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the largest closing that is safe on any object."""
    safe = largest_step(
        force_high_n=estimate.force_high_n,
        steepest_n=plan.steepest_n,
        rate=0.0,
        damage_low_n=estimate.damage_low_n,
        limits=plan.safety,
    )
    return safe - estimate.tracking_lag


def _largest_blind_step(estimate: ContactEstimate, plan: Plan) -> float:
    """Return the largest step while the damage limit is unknown.

    Counted from the first force that can't be drift: below it no step shows a limit.
    A small force on one finger only pushes the object to the middle, and is no squeeze.
    """
    if plan.damage is None or not math.isinf(estimate.damage_low_n):
        return math.inf
    force_n = sheet_forces_n(estimate.steps, estimate, plan)
    shared = np.array([step.touch.weaker_percent for step in estimate.steps])
    both = (shared <= READING.contact_percent) | (force_n > plan.no_push_n)
    felt = both & (force_n > CONTACT_SD * floor_n(plan))
    if not felt.any():
        return math.inf
    soft_n = SQUEEZE.soft_n_per_mm * mm_per_unit(plan)
    longest = 2 * SQUEEZE.min_rise_n * (1.0 / plan.steepest_n + 1.0 / soft_n)
    return estimate.steps[int(np.argmax(felt))].closure + longest - estimate.closure


def quantize_target(closure: float, plan: Plan, *, within: bool = False) -> float:
    """Round the target of a closure to the drive's steps, to the nearest or down.

    A gripper would round it itself, but then a replay would not know.
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
