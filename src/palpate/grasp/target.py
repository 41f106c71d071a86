"""Whether the settled force is where it should be: short of the target, over it, kept below it."""

from __future__ import annotations

import math

from palpate.estimate.measurement import Measurement
from palpate.grasp.answer import measured_stiffness
from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.grasp.step_size import deformed_mm, force_now

#: An object that is surely stiffer gives way so much less than fingers and pads that a firmer
#: squeeze would not show how stiff it is.
_FIRM_N_PER_MM = 6.0


def goal_n(plan: Plan) -> float:
    """Return the force that the plan is after."""
    target_n = plan.gentle_force_n if plan.target_force_n is None else plan.target_force_n
    return max(target_n, plan.lift_force_n or 0.0)


def gentle_goal(belief: Belief, plan: Plan) -> tuple[float, str]:
    """Return where a squeeze without target ends, newtons, and why it ends there.

    An object that has given way as far as every recorded fruit bore is pressed no further, whatever
    is known of it. One that surely gives way little is pressed harder, until it is known or is
    deformed as far as it may be.
    """
    goal_n = max(plan.gentle_force_n, plan.lift_force_n or 0.0)
    if plan.lift_force_n is not None:
        return goal_n, "force_reached"
    if deformed_mm(belief, plan) >= plan.gentle_mm:
        return 0.0, "gave_way"
    if plan.gripper.drive == "pressure":
        # Soft fingers don't feel how far an object gives way: pressing on would teach nothing.
        return 0.5 * goal_n, "force_reached"
    if belief.force_n < goal_n:
        return goal_n, "force_reached"
    stiffness = measured_stiffness(belief, force_now(belief, plan), plan=plan)
    if stiffness is None:
        return goal_n, "force_reached"
    if _known(stiffness, share=plan.stiffness_share):
        return goal_n, "stiffness_known"
    return max(goal_n, min(plan.firm_force_n, plan.firm_mm * stiffness.low)), "firm_enough"


def _known(stiffness: Measurement, *, share: float) -> bool:
    """Whether a stiffness is known well enough, or is above what a small force can measure."""
    near = stiffness.high / stiffness.low <= (1.0 + share) / (1.0 - share)
    return near or stiffness.low > _FIRM_N_PER_MM


def missing_n(belief: Belief, plan: Plan) -> float:
    """Return by how much the settled force falls short of the target, or of being sure to lift."""
    force = belief.result.force_n
    if force is None:
        return 0.0
    of_target_n = 0.0 if plan.target_force_n is None else plan.target_force_n - force.middle
    if plan.lift_force_n is None:
        return of_target_n
    return max(of_target_n, plan.lift_force_n - force.low)


def short(belief: Belief, plan: Plan) -> bool:
    """Whether the settled force falls short by more than is tolerated, or is not sure to lift."""
    too_little = missing_n(belief, plan) > plan.target_tolerance * goal_n(plan)
    return too_little or not lifts(belief, plan)


def limited(belief: Belief, plan: Plan) -> bool:
    """Whether the damage limit forbids some of what is missing."""
    force = belief.result.force_n
    if force is None or plan.damage is None:
        return False
    if math.isinf(belief.damage_low_n):
        # Nothing is known of it, and so nothing more is allowed.
        return True
    lowest = belief.damage_low_n < plan.safety.force_ceiling_n
    return lowest and missing_n(belief, plan) > belief.damage_low_n - force.high


def over(belief: Belief, plan: Plan) -> bool:
    """Whether the settled force is above the target by more than is tolerated, and may be less."""
    force, wanted_n = belief.result.force_n, goal_n(plan)
    if force is None or plan.target_force_n is None:
        return False
    low_n = force.low * wanted_n / max(force.middle, wanted_n)
    enough = plan.lift_force_n is None or low_n >= plan.lift_force_n
    return enough and force.middle > (1.0 + plan.target_tolerance) * wanted_n


def astray(belief: Belief, plan: Plan) -> bool:
    """Whether the target is missed so clearly that the uncertainty does not matter."""
    if plan.target_force_n is None or belief.adjustments >= plan.most_adjustments:
        return False
    too_little = missing_n(belief, plan) > plan.target_tolerance * goal_n(plan)
    return too_little or over(belief, plan)


def noted_on_target(belief: Belief, plan: Plan) -> Belief:
    """Note when the settled force is first known to be on target since the last movement."""
    moments = belief.result.moments
    known = any(m.name == "on_target" and m.time_s > belief.moved_s for m in moments)
    near = missing_n(belief, plan) <= plan.target_tolerance * goal_n(plan)
    if plan.target_force_n is None or known or not near or over(belief, plan):
        return belief
    return belief.noted("on_target")


def lifts(belief: Belief, plan: Plan) -> bool:
    """Whether the settled force is sure to lift the object, if it is to be lifted."""
    force = belief.result.force_n
    if plan.lift_force_n is None:
        return True
    return force is not None and force.low >= plan.lift_force_n
