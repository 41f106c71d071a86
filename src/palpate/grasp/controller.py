"""One step of a grasp: a belief and an observation in, a belief and perhaps a command out. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.grasp import target
from palpate.grasp.answer import (
    FELT_PERCENT,
    answered,
    examined,
    felt_steps,
    forecast,
    sure_enough,
)
from palpate.grasp.approaching import begun, look_again, remembered, stood, swept, unreleased
from palpate.grasp.belief import Belief, Observation, observed
from palpate.grasp.correcting import come_back, eased, pressed_on
from palpate.grasp.paper_method import close_by_extra, close_until_mean, settle_exponentially
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.releasing import Move, blind, nothing_there, release, stuck
from palpate.grasp.result import Outcome
from palpate.grasp.rezero import proved, rezeroed
from palpate.grasp.safety import Danger, Reaction, reaction
from palpate.grasp.step_size import (
    approach_step,
    clamped,
    closed_by,
    pressed,
    read,
    sent_to,
    wanted_step,
    whole,
)
from palpate.gripper.interface import GripperCommand

_HOLDING = (Phase.SQUEEZE, Phase.SETTLE, Phase.ADJUST, Phase.EASE, Phase.HOLD)
#: Phases in which a movement closes on an object; it is stopped where the frames show this multiple
#: of the target (guess: a correction starts at up to 1.05 of it, read by a sheet that creeps).
_CLOSING = (Phase.SQUEEZE, Phase.SETTLE)
_TOO_FAR_SHARE = 1.25
#: The sheet shows a rising force this late, seconds (simulated: 0.06 to 0.12 s).
_SHEET_LATE_S = 0.1
#: Less than this share of the strongest touch of this grip means that the object is gone.
_LOST_SHARE = 0.35
#: A sheet that shows this much less than at its strongest step, though the hand has closed on this
#: often since, does not show the force, or the object gives way: neither is pressed on. Nor is what
#: shows less by the second share of it at each of so many steps, however little that is in all.
_FALLS_SHARE, _FALLS_STEPS = 0.25, 2
_EACH_SHARE, _EACH_STEPS = 0.01, 3
#: Nor what shows this much more where the hand has opened a little: no sheet creeps as fast.
_RISES_SHARE = 0.1
#: The squeeze ends a little below the target: what is left is corrected by settled forces.
_NEAR = 0.93
_FALLS = (
    "the sheet shows less and less while the hand closes on, or more where it opens: the object "
    "gives way, or the sheet does not show the force; see what `palpate doctor` reports"
)
#: A grip presses both fingers alike: one that feels this multiple of a hint where the other feels
#: less than one is alone (150 healthy simulated grasps never show it while the hand stands).
_ALONE_HINTS, _ALONE_FRAMES = 2.0, 3
_ALONE = (
    "finger {} feels a grip and the other feels nothing: one sheet does not read, or the object "
    "lies off it; see what `palpate doctor` reports"
)
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
        `safety.largest_step` allows: what a phase wishes is cut to that here, and only here.
    """
    belief, wish = _wished(observed(belief, observation, plan=plan), plan)
    command = clamped(belief, wish, plan)
    return (belief if command is None else sent_to(belief, command.target, plan)), command


def _wished(belief: Belief, plan: Plan) -> Move:
    """Return what is believed and wished now: by the dangers first, then by the phase."""
    if belief.phase not in (Phase.RELEASE, Phase.STOPPED):
        if belief.watched_n > plan.safety.force_ceiling_n:
            belief = pressed(
                belief,
                force_n=belief.watched_n,
                force_high_n=max(belief.watched_n, belief.force_high_n),
            )
        if belief.force_n > plan.safety.force_ceiling_n:
            return stopped(belief, Danger.FORCE_LIMIT, plan=plan)
        if _closes_too_far(belief, plan):
            # No further than it reports to be: a stop is never cut.
            here = whole(belief.closure - belief.behind, plan, within=True)
            return belief, GripperCommand(target=here, rate=plan.gripper.fastest)
        if belief.phase in _HOLDING and _grip_lost(belief):
            return release(belief, plan, Outcome.SLIPPED)
        if _feels_alone(belief, plan):
            strong = int(np.argmin(belief.now.finger_percent))
            return stopped(belief.with_fault(_ALONE.format(strong)), Danger.SENSOR_LOST, plan=plan)
        if belief.phase in _HOLDING and (_falls(belief) or _rises(belief, plan)):
            return release(belief.with_fault(_FALLS), plan, Outcome.SENSOR_LOST)
        if belief.phase is not Phase.HOLD and belief.lasted_s > plan.longest_s:
            return release(belief, plan, Outcome.TIMED_OUT)
    handlers = HANDLERS if plan.paper is None else PAPER_HANDLERS
    return handlers[belief.phase](belief, plan)


def _closes_too_far(belief: Belief, plan: Plan) -> bool:
    """Return whether a hand that closes presses more than it was sent on for before it stops."""
    moving = belief.still_since_s is None and belief.closure < belief.sent
    if not moving or plan.target_force_n is None or belief.phase not in _CLOSING:
        return False
    late_s = _SHEET_LATE_S + belief.period_s + plan.safety.latency_s
    ahead_n = belief.watched_n + late_s * belief.rise_n_per_s
    return ahead_n > _TOO_FAR_SHARE * target.goal_n(plan)


def stopped(belief: Belief, danger: Danger, *, plan: Plan) -> Move:
    """End the grasp because of a danger, as `safety.reaction` decides for its phase."""
    outcome = Outcome(danger.outcome)
    if reaction(danger, phase=belief.phase, drive=plan.gripper.drive) is Reaction.OPEN:
        return release(belief, plan, outcome)
    belief = replace(belief, result=replace(belief.result, outcome=outcome))
    return belief.enter(Phase.STOPPED, note=outcome.value), None


def released(belief: Belief, *, plan: Plan) -> Move:
    """End the grasp because its user wants the object back: held if there is an answer."""
    answered = belief.result.force_n is not None
    return release(belief, plan, Outcome.HELD if answered else Outcome.STOPPED)


def _wait(belief: Belief, plan: Plan) -> Move:
    """Stand open until it is time to try again, or somebody touches a finger."""
    opened = belief.closure <= plan.step / 2
    if not opened or belief.now_s - belief.since_s < plan.dwell_s:
        return belief, None
    touched = any(moment.name == "touch" for moment in belief.result.moments[-1:])
    if belief.still_s < plan.wait_s and not touched:
        return belief, None
    # Rest values are taken again, from now on.
    again = replace(
        belief,
        rest_ohm=None,
        staircase=(),
        pulls=(),
        touches=(),
        fingers=(),
        sweep=None,
        swept_to=math.nan,
        felt_s=None,
        released_s=None,
        met=None,
        memory=None,
        still_since_s=belief.now_s,
    )
    return again.enter(Phase.APPROACH), None


def _approach(belief: Belief, plan: Plan) -> Move:
    """Take the rest values, then close step by step until both fingers feel something."""
    if belief.rest_ohm is None:
        if belief.still_s < plan.rest_s or len(belief.rest_frames) < plan.rest_frames:
            return belief, None
        belief = rezeroed(belief, plan=plan)
        return (belief, None) if belief.rest_ohm is None else _onward(belief, plan)
    if belief.still_s < plan.dwell_s or not belief.touches:
        return belief, None
    if belief.released_s is not None and belief.memory is None:
        return stuck(belief, plan) if unreleased(belief, plan) else remembered(belief, plan)
    if belief.proving_from is not None:
        belief = proved(belief, plan=plan)
        if not belief.touches:
            return belief, None
    before = belief.staircase[-1].closure if belief.staircase else 0.0
    belief = read(belief, plan)
    if belief.now.shared_percent <= plan.epsilon_percent or _pressed(belief, plan):
        width_mm = plan.gripper.target(before) if plan.gripper.drive == "width" else None
        result = replace(belief.result, previous_width_mm=width_mm)
        contact_s = belief.contact_s if belief.contact_s is not None else belief.moved_s
        return replace(belief, result=result, contact_s=contact_s).enter(Phase.CONTACT), None
    if belief.closure >= plan.gripper.span - 2 * plan.smallest_step:
        return nothing_there(belief, plan)
    if belief.now.shared_percent > plan.hint_percent:
        belief, command = _onward(replace(belief, contact_s=None), plan)
    else:
        if belief.contact_s is None:
            belief = replace(belief, contact_s=belief.moved_s)
        command = closed_by(belief, wanted_step(belief, plan, goal_n=0.0), plan)
    if command is not None or belief.phase is Phase.SWEEP:
        return belief, command
    if belief.force_high_n >= plan.safety.force_ceiling_n:
        return blind(belief, plan)
    # A touch too weak to be contact, and no room to press harder: measure what there is.
    return belief.enter(Phase.SETTLE, note="contact"), None


def _onward(belief: Belief, plan: Plan) -> Move:
    """Close on: finely while it may be that something presses, at speed where nothing was felt."""
    felt = bool(belief.touches) and belief.now.deepest_percent <= FELT_PERCENT
    # A weak thing may not bear a whole step more; what it bears is not known yet.
    if belief.proving_from is not None or (plan.damage is not None and felt):
        return belief, closed_by(belief, plan.fine_step, plan)
    if not belief.closure <= belief.swept_to + approach_step(plan):
        return begun(belief, plan), None
    # One finger alone pushes the object to the middle: the next touch is still to come.
    share = 1.0 if felt and belief.released_s is None else 0.5
    step = max(share * approach_step(plan), plan.fine_step)
    if plan.damage is None and not felt:
        step = max(step, look_again(belief, plan) - belief.closure)
    return belief, closed_by(belief, step, plan)


def _contact(belief: Belief, plan: Plan) -> Move:
    """Confirm the touch on fresh frames: noise may look like one for a moment."""
    if belief.now_s - belief.since_s < plan.confirm_s:
        return belief, None
    faint = belief.now.deepest_percent > 0.5 * plan.epsilon_percent
    if faint and not _pressed(belief, plan):
        return belief.enter(Phase.APPROACH), None
    return belief.enter(Phase.SQUEEZE, note=None if _touch_noted(belief) else "contact"), None


def _touch_noted(belief: Belief) -> bool:
    """Whether the touch was sure already where the way at speed ended."""
    moments, felt_s = belief.result.moments, belief.felt_s
    return felt_s is not None and any(m.name == "contact" and m.time_s > felt_s for m in moments)


def _squeeze(belief: Belief, plan: Plan) -> Move:
    """Close further until the force is near the target, or enough to measure."""
    if belief.still_s < plan.dwell_s:
        return belief, None
    belief = read(belief, plan)
    # A gentle squeeze is not corrected afterwards, and may exceed its force to measure the
    # stiffness.
    aimed, why = plan.target_force_n is not None, None
    if aimed:
        goal_n = _NEAR * target.goal_n(plan)
    else:
        goal_n, why = target.gentle_goal(belief, plan)
    borne = belief.met is not None and belief.closure < belief.met[0]
    measures = not aimed and (why != "gave_way" or borne)
    few = measures and felt_steps(belief, plan) < plan.fewest_steps
    if belief.force_n < goal_n or few:
        wish = closed_by(belief, wanted_step(belief, plan, goal_n=goal_n), plan)
        if wish is not None:
            return belief, wish
    return belief.enter(Phase.SETTLE, note=why), None


def _settle(belief: Belief, plan: Plan) -> Move:
    """Stand still until the settled force is known well enough, or is clearly not the target."""
    if belief.still_s >= plan.dwell_s and belief.adjustments:
        belief = read(belief, plan)
    looking = plan.decide_after_s if plan.target_force_n is None else plan.correct_after_s
    if belief.still_s < max(looking, belief.next_forecast_s):
        return belief, None
    belief = replace(belief, next_forecast_s=belief.still_s + _FORECAST_EVERY_S)
    settled = forecast(belief, plan=plan)
    belief = answered(belief, settled, plan=plan)
    belief = target.noted_on_target(belief, plan)
    if (
        target.astray(belief, plan)
        or sure_enough(settled, plan=plan)
        or belief.still_s >= plan.decide_by_s
    ):
        return examined(belief, plan=plan).enter(Phase.ADJUST), None
    return belief, None


def _adjust(belief: Belief, plan: Plan) -> Move:
    """Correct the settled force, up or down, until it is near the target."""
    limited = target.limited(belief, plan)
    if belief.adjustments < plan.most_adjustments:
        # Up to a damage limit one correction goes as far as it may; more would only wait there.
        if target.short(belief, plan) and not (limited and belief.adjustments):
            moved, command = pressed_on(belief, plan, missing_n=target.missing_n(belief, plan))
            if command is not None:
                return moved.enter(Phase.SETTLE, note="adjusted"), command
        elif target.over(belief, plan):
            moved, command = eased(belief, plan, goal_n=target.goal_n(plan))
            return moved.enter(Phase.EASE, note="eased"), command
    if limited and target.short(belief, plan):
        belief = belief.noted("damage_limit")
    if not target.lifts(belief, plan):
        return release(belief, plan, Outcome.TOO_WEAK)
    return belief.enter(Phase.HOLD, note="answer"), None


def _ease(belief: Belief, plan: Plan) -> Move:
    """Come back from below to where the settled force should be right."""
    if belief.still_s < plan.confirm_s:
        return belief, None
    belief, wish = come_back(belief, plan)
    command = clamped(belief, wish, plan)
    if wish is not None and command is not None and command.target != wish.target:
        return belief, wish
    return belief.enter(Phase.SETTLE, note="adjusted"), wish


def _hold(belief: Belief, plan: Plan) -> Move:
    """Keep holding for the plan's `hold_s`."""
    if belief.now_s - belief.since_s < plan.hold_s:
        return belief, None
    return release(belief, plan, Outcome.HELD)


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
    Phase.WAIT: _wait,
    Phase.APPROACH: _approach,
    Phase.SWEEP: swept,
    Phase.FELT: stood,
    Phase.CONTACT: _contact,
    Phase.SQUEEZE: _squeeze,
    Phase.SETTLE: _settle,
    Phase.ADJUST: _adjust,
    Phase.EASE: _ease,
    Phase.HOLD: _hold,
    Phase.RELEASE: _releasing,
    Phase.STOPPED: _nothing,
}
#: The phases of the paper's method (`plan.paper`): the other ones are as above.
PAPER_HANDLERS: dict[Phase, Callable[[Belief, Plan], Move]] = {
    **HANDLERS,
    Phase.APPROACH: close_until_mean,
    Phase.SQUEEZE: close_by_extra,
    Phase.SETTLE: settle_exponentially,
}


def _pressed(belief: Belief, plan: Plan) -> bool:
    """Whether there is force enough for a grip, though a finger feels little.

    One finger alone may only push the object to the middle; with that much force it does not.
    """
    return belief.force_n > plan.no_push_n


def _grip_lost(belief: Belief) -> bool:
    """Whether the sheet no longer feels what it felt since the last movement, or in the squeeze."""
    if belief.still_s < 0.3 or len(belief.touches) < 6:
        return False
    strongest = belief.strongest
    came_back = not math.isnan(belief.again)
    if belief.staircase and not came_back:
        strongest = max(strongest, belief.staircase[-1].touch.reading)
    return belief.now.reading < _LOST_SHARE * strongest


def _feels_alone(belief: Belief, plan: Plan) -> bool:
    """Return whether one finger feels a grip while the other feels nothing."""
    gripping = belief.phase is Phase.CONTACT or belief.phase in _HOLDING
    if not gripping or belief.still_s < plan.dwell_s or len(belief.touches) < _ALONE_FRAMES:
        return False
    now = belief.now
    pressed_percent = min(now.finger_percent)
    return now.shared_percent > plan.hint_percent and (
        pressed_percent <= _ALONE_HINTS * plan.hint_percent
    )


def _falls(belief: Belief) -> bool:
    """Whether the sheet has shown less and less while the hand closed on.

    Counted from where both fingers feel something: one alone pushes, until the other comes.
    """
    gripped = [
        c.touch.reading
        for c in belief.staircase
        if belief.contact_s is not None
        and c.touch.time_s >= belief.contact_s
        and c.touch.shared_percent <= FELT_PERCENT
    ]
    if not gripped or belief.staircase[-1].touch.deepest_percent > FELT_PERCENT:
        return False
    strongest = int(np.argmax(gripped))
    fallen = 1.0 - np.array(gripped[strongest:]) / gripped[strongest]
    if len(fallen) > _EACH_STEPS and np.diff(fallen)[-_EACH_STEPS:].min() > _EACH_SHARE:
        return True
    return len(fallen) > _FALLS_STEPS and bool(fallen[-1] > _FALLS_SHARE)


def _rises(belief: Belief, plan: Plan) -> bool:
    """Whether the sheet shows more after the hand has opened than at its furthest step."""
    if belief.phase is not Phase.EASE or belief.still_s < plan.confirm_s or not belief.touches:
        return False
    furthest = belief.staircase[-1]
    opened = belief.closure < furthest.closure
    return opened and belief.now.reading > (1.0 + _RISES_SHARE) * furthest.touch.reading
