"""One step of a grasp: a belief and an observation in, a belief and perhaps a command out. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

from palpate.grasp.answer import answered, forecast, sure_enough
from palpate.grasp.belief import Belief, Closing, Observation, observed, rezeroed
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.safety import Danger, Reaction, largest_step, reaction
from palpate.gripper.interface import GripperCommand

#: A handler's answer: what it believes now, and what it wants of the gripper (None: nothing).
Move = tuple[Belief, GripperCommand | None]

_HOLDING = (Phase.SQUEEZE, Phase.SETTLE, Phase.ADJUST, Phase.HOLD)
#: Less than this share of the strongest touch of this hold means that the object is gone.
_LOST_SHARE = 0.35
_RELEASE_TIMEOUT_S = 10.0
_FORECAST_EVERY_S = 0.2


def step(belief: Belief, observation: Observation, *, plan: Plan) -> Move:
    """Take in one observation and decide.

    Parameters
    ----------
    belief : Belief
        What was known before.
    observation : Observation
        The new frame and the gripper's state with it.
    plan : Plan
        What is to be done, and within which bounds.

    Returns
    -------
    Belief, GripperCommand or None
        What is known now, and the command to send, if any. It never closes further than
        `safety.largest_step` allows.
    """
    belief = observed(belief, observation, plan=plan)
    if belief.phase not in (Phase.RELEASE, Phase.STOPPED):
        if belief.force_n > plan.safety.force_ceiling_n:
            return stopped(belief, Danger.FORCE_LIMIT, plan=plan)
        if belief.phase in _HOLDING and _grip_lost(belief):
            return _release(belief, plan, Outcome.SLIPPED)
        if belief.lasted_s > plan.longest_s:
            return _release(belief, plan, Outcome.TIMED_OUT)
    return HANDLERS[belief.phase](belief, plan)


def stopped(belief: Belief, danger: Danger, *, plan: Plan) -> Move:
    """End the grasp because of a danger, as `safety.reaction` says for its phase."""
    outcome = Outcome(danger.value)
    if reaction(danger, phase=belief.phase, drive=plan.gripper.drive) is Reaction.OPEN:
        return _release(belief, plan, outcome)
    belief = replace(belief, result=replace(belief.result, outcome=outcome))
    return belief.enter(Phase.STOPPED, note=outcome.value), None


def released(belief: Belief, *, plan: Plan) -> Move:
    """End the grasp because its user wants the object back: held if there is an answer."""
    answered = belief.result.force_n is not None
    return _release(belief, plan, Outcome.HELD if answered else Outcome.STOPPED)


def _approach(belief: Belief, plan: Plan) -> Move:
    """Take the rest values, then close step by step until something is felt."""
    if belief.rest_ohm is None:
        if belief.still_s < plan.rest_s:
            return belief, None
        return _closed_by(rezeroed(belief, plan=plan), plan.step, plan)
    if belief.still_s < plan.dwell_s:
        return belief, None
    before = belief.staircase[-1].closure if belief.staircase else 0.0
    belief = _read(belief, plan)
    if belief.now.deepest_percent <= plan.epsilon_percent:
        width_mm = plan.gripper.target(before) if plan.gripper.drive == "width" else None
        result = replace(belief.result, previous_width_mm=width_mm)
        contact_s = belief.contact_s if belief.contact_s is not None else belief.moved_s
        return replace(belief, result=result, contact_s=contact_s).enter(Phase.CONTACT), None
    if belief.closure >= plan.gripper.span - 2 * plan.smallest_step:
        return _release(belief, plan, Outcome.NOTHING_THERE)
    if belief.now.deepest_percent > plan.hint_percent:
        return _closed_by(replace(belief, contact_s=None), plan.step, plan)
    if belief.contact_s is None:
        belief = replace(belief, contact_s=belief.moved_s)
    belief, command = _closed_by(belief, _wanted_step(belief, plan), plan)
    # A touch too weak to be contact, and no room to press harder: measure what there is.
    return (belief, command) if command else (belief.enter(Phase.CONTACT), None)


def _contact(belief: Belief, plan: Plan) -> Move:
    """Confirm the touch on fresh frames: noise may look like one for a moment."""
    if belief.now_s - belief.since_s < plan.confirm_s:
        return belief, None
    if belief.now.deepest_percent > 0.5 * plan.epsilon_percent:
        return belief.enter(Phase.APPROACH), None
    return belief.enter(Phase.SQUEEZE, note="contact"), None


def _squeeze(belief: Belief, plan: Plan) -> Move:
    """Close further until the force is near the target, or enough to measure."""
    if belief.still_s < plan.dwell_s:
        return belief, None
    belief = _read(belief, plan)
    goal_n = plan.gentle_force_n if plan.target_force_n is None else 0.9 * plan.target_force_n
    felt = [c for c in belief.staircase if c.touch.deepest_percent < plan.hint_percent]
    enough = belief.force_n >= goal_n and len(felt) >= plan.fewest_steps
    if not enough:
        belief, command = _closed_by(belief, _wanted_step(belief, plan), plan)
        if command is not None:
            return belief, command
    return belief.enter(Phase.SETTLE), None


def _settle(belief: Belief, plan: Plan) -> Move:
    """Stand still until the settled value can be told well enough, or time is up."""
    if belief.still_s < plan.decide_after_s or belief.still_s < belief.next_forecast_s:
        return belief, None
    belief = replace(belief, next_forecast_s=belief.still_s + _FORECAST_EVERY_S)
    settled = forecast(belief, plan=plan)
    if not sure_enough(settled, plan=plan) and belief.still_s < plan.decide_by_s:
        return belief, None
    return answered(belief, settled, plan=plan).enter(Phase.ADJUST), None


def _adjust(belief: Belief, plan: Plan) -> Move:
    """Press a little more if the settled force falls short of the target; never less.

    One-sided, because the sheet's answer to unloading was not calibrated.
    """
    force = belief.result.force_n
    if force is not None and plan.target_force_n is not None:
        missing_n = plan.target_force_n - force.value
        short = missing_n > plan.target_tolerance * plan.target_force_n
        if short and belief.adjustments < plan.most_adjustments:
            step = missing_n / _slope_high_n(belief, plan)
            moved, command = _closed_by(_read(belief, plan), step, plan)
            if command is not None:
                moved = replace(moved, adjustments=belief.adjustments + 1, next_forecast_s=0.0)
                return moved.enter(Phase.SETTLE, note="adjusted"), command
    return belief.enter(Phase.HOLD, note="answer"), None


def _hold(belief: Belief, plan: Plan) -> Move:
    """Keep holding for as long as the plan says."""
    if belief.now_s - belief.since_s < plan.hold_s:
        return belief, None
    return _release(belief, plan, Outcome.HELD)


def _releasing(belief: Belief, plan: Plan) -> Move:
    """Wait until the hand is open."""
    # Half a step: closer than that some grippers never report themselves.
    opened = belief.closure <= plan.step / 2
    if opened or belief.now_s - belief.since_s > _RELEASE_TIMEOUT_S:
        return belief.enter(Phase.STOPPED), None
    return belief, None


def _nothing(belief: Belief, plan: Plan) -> Move:
    return belief, None


HANDLERS: dict[Phase, Callable[[Belief, Plan], Move]] = {
    Phase.APPROACH: _approach,
    Phase.CONTACT: _contact,
    Phase.SQUEEZE: _squeeze,
    Phase.SETTLE: _settle,
    Phase.ADJUST: _adjust,
    Phase.HOLD: _hold,
    Phase.RELEASE: _releasing,
    Phase.STOPPED: _nothing,
}


def _read(belief: Belief, plan: Plan) -> Belief:
    """Read the force now and its upper bound; a step that is read for the first time is a stair.

    Read again later, the sheet has crept: the early law would call that force.
    """
    touch, stairs = belief.now, belief.staircase
    if not stairs or belief.moved_s >= stairs[-1].touch.time_s:
        stairs = (*stairs, Closing(closure=belief.closure, touch=touch))
    force = plan.early_law.force_n(touch.reading, level=plan.level)
    force_n, force_high_n = float(force.value), float(force.high)
    return replace(
        belief,
        staircase=stairs,
        force_n=force_n,
        force_high_n=force_high_n,
        peak_force_n=max(belief.peak_force_n, force_n),
    )


def _closed_by(belief: Belief, step: float, plan: Plan) -> Move:
    """Close by a step, cut to what is safe; no command if that is not worth a movement."""
    safe = largest_step(
        force_high_n=belief.force_high_n,
        steepest_n=plan.steepest_n,
        ceiling_n=plan.safety.force_ceiling_n,
    )
    step = min(step, safe, plan.gripper.span - belief.closure)
    if step < plan.smallest_step:
        return belief, None
    belief = replace(belief, still_since_s=None, touches=(), moved_s=belief.now_s)
    return belief, GripperCommand(target=plan.gripper.target(belief.closure + step), rate=plan.rate)


def _wanted_step(belief: Belief, plan: Plan) -> float:
    """Return the step that should raise the force by a fixed amount, or less near the target."""
    rise_n = plan.force_step_n
    if plan.target_force_n is not None:
        rise_n = max(rise_n, 0.4 * (plan.target_force_n - belief.force_n))
    steepest = max(_slope_high_n(belief, plan), rise_n / plan.step)
    return max(rise_n / steepest, plan.smallest_step)


def _slope_high_n(belief: Belief, plan: Plan) -> float:
    """Return how steeply the force rises: as the last steps saw, with room for stiffening."""
    law = plan.early_law
    curve = [(c.closure, float(law.force_n(c.touch.reading).value)) for c in belief.staircase[-3:]]
    slopes = [
        (f1 - f0) / (x1 - x0) for (x0, f0), (x1, f1) in pairwise(curve) if x1 > x0 and f1 > f0
    ]
    return min(1.3 * max(slopes), plan.steepest_n) if slopes else plan.steepest_n


def _grip_lost(belief: Belief) -> bool:
    """Whether the sheet no longer feels what it felt since the last movement."""
    if belief.still_s < 0.3 or len(belief.touches) < 6:
        return False
    strongest = max(t.reading for t in belief.touches)
    return belief.now.reading < _LOST_SHARE * strongest


def _release(belief: Belief, plan: Plan, outcome: Outcome) -> Move:
    """Open the hand: the grasp is over."""
    belief = replace(belief, result=replace(belief.result, outcome=outcome))
    command = GripperCommand(target=plan.gripper.target(0.0), rate=plan.gripper.fastest)
    return belief.enter(Phase.RELEASE, note=outcome.value), command
