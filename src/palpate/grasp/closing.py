"""How far to close next: what the last steps taught, and what is safe."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from palpate.estimate.closing import ClosingCurve
from palpate.grasp.belief import Belief, Closing
from palpate.grasp.plan import Plan
from palpate.grasp.safety import DAMAGE_RATE, largest_step
from palpate.gripper.interface import GripperCommand

#: Room for stiffening over a step beyond what the last steps showed.
_STIFFENING = 1.3
#: The spike of a fine step has mostly faded, and a few frames have come.
_QUICKEST_S = 0.2
#: Share of what is missing to the target that one step of the squeeze may close.
_BOLD = 0.6


def approach_step(plan: Plan) -> float:
    """Return the step before contact: such that not even a rigid object gets more than the target.

    Without a target it is the plan's.
    """
    if plan.target_force_n is None:
        return plan.step
    afforded = plan.target_force_n / plan.steepest_n
    return min(max(afforded, plan.fine_step), plan.step)


def approach_dwell_s(belief: Belief, plan: Plan) -> float:
    """Return how long to wait after a step: a finer one disturbs the sheet less.

    Once something is felt, it is read as the calibration was.
    """
    felt = belief.now.shared_percent <= plan.hint_percent if belief.touches else True
    quick_s = plan.dwell_s * approach_step(plan) / plan.step
    return plan.dwell_s if felt else max(quick_s, _QUICKEST_S)


def read(belief: Belief, plan: Plan) -> Belief:
    """Read the force now and its upper bound; a step that is read for the first time is a stair.

    Read again later, the sheet has crept: the early law would call that force.
    """
    touch, stairs = belief.now, belief.staircase
    if stairs and belief.moved_s < stairs[-1].touch.time_s:
        return belief
    stairs = (*stairs, Closing(closure=belief.closure, touch=touch))
    force = plan.early_law.force_n(touch.reading, level=plan.level)
    force_n, force_high_n = float(force.value), float(force.high)
    belief = replace(
        belief,
        staircase=stairs,
        force_n=force_n,
        force_high_n=force_high_n,
        peak_force_n=max(belief.peak_force_n, force_n),
    )
    return replace(belief, damage_low_n=_damage_low_n(belief, plan))


def closed_by(belief: Belief, step: float, plan: Plan) -> tuple[Belief, GripperCommand | None]:
    """Close by a step, cut to what is safe; no command if that is not worth a movement."""
    rate = plan.rate if belief.contact_s is None else plan.squeeze_rate
    safe = largest_step(
        force_high_n=belief.force_high_n,
        steepest_n=plan.steepest_n,
        rate=rate,
        damage_low_n=belief.damage_low_n,
        limits=plan.safety,
    )
    step = min(step, safe, plan.gripper.span - belief.closure)
    if step < plan.smallest_step:
        return belief, None
    sent = belief.closure + step
    belief = replace(belief, still_since_s=None, touches=(), moved_s=belief.now_s, sent=sent)
    return belief, GripperCommand(target=plan.gripper.target(sent), rate=rate)


def wanted_step(belief: Belief, plan: Plan, *, goal_n: float) -> float:
    """Return the step that should raise the force by a fixed amount, or by more far from the goal.

    No longer than the steps before contact until the force is well above what noise reads.
    """
    rise_n = max(plan.force_step_n, _BOLD * (goal_n - belief.force_n))
    steepest_n = slope_high_n(belief, plan)
    faint = belief.force_n < plan.force_step_n
    longest = approach_step(plan) if faint else 3.0 * plan.step
    return max(min(rise_n / steepest_n, longest), plan.smallest_step)


def slope_high_n(belief: Belief, plan: Plan) -> float:
    """Return how steeply the force may rise: as the last steps saw, with room for stiffening."""
    return min(_STIFFENING * slope_n(belief, plan), plan.steepest_n)


def slope_n(belief: Belief, plan: Plan) -> float:
    """Return how steeply the force rose over the last steps, N per mm or kPa."""
    law = plan.early_law
    curve = [(c.closure, float(law.force_n(c.touch.reading).value)) for c in belief.staircase[-3:]]
    slopes = [
        (f1 - f0) / (x1 - x0) for (x0, f0), (x1, f1) in pairwise(curve) if x1 > x0 and f1 > f0
    ]
    return min(max(slopes), plan.steepest_n) if slopes else plan.steepest_n


def _damage_low_n(belief: Belief, plan: Plan) -> float:
    """Return the lower bound of the damage limit that the force-closure curve so far tells.

    The guard's other rule, hazard of the next few percent of force, needs a finer and smoother
    curve than a sheet gives in steps: there it takes every wobble of a reading for a bend.
    """
    if plan.damage is None or plan.give is None:
        return math.inf
    curve, states = ClosingCurve(), []
    # What one finger feels alone is no squeeze.
    gripped = (c for c in belief.staircase if c.touch.shared_percent <= plan.hint_percent)
    for stair in gripped:
        force_n = float(plan.early_law.force_n(stair.touch.reading).value)
        given_mm = float(plan.give.give_mm(force_n))
        states += curve.push(stair.closure - given_mm, force_n=force_n)
    if not states:
        return math.inf
    return plan.damage.bound_n(states[-1], kind=plan.kind, rate=DAMAGE_RATE)
