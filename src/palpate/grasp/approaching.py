"""The approach: at speed until something is felt, back, and then finely until it is a touch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from palpate.grasp.answer import FELT_PERCENT
from palpate.grasp.belief import Belief, Touch
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.step_size import approach_step, closure_of, pressed, safe_step, whole
from palpate.grasp.sweep import Sweep, blind_s
from palpate.gripper.interface import GripperCommand

#: How long a pixel hides its own fall under load: the rise that a movement and a rising load make
#: fades with 0.06 to 0.12 s.
_SHEET_LAG_S = 0.06
#: A hand that stands still has lost the spike of its movement after this time.
QUIET_S = 0.21
#: Steps of the approach that the hand may go on after a touch. On development sensors of the twin a
#: touch at this speed presses no harder in the median than steps that are waited for.
_OVERRUN_STEPS = 2.0
#: Commands reach this many frames ahead, and a little more: if no more comes, the hand stops by
#: itself. Where nothing is expected yet, going faster is worth a halt at a frame that is late.
_FRAMES, _HASTE_FRAMES, _AHEAD_S = 2.0, 1.25, 0.02
#: A hand that does not move is sent on after this time.
_IDLE_S = 0.7
#: A hand that comes back goes at most this many steps.
_FURTHER_BACK_STEPS = 4.0
#: A sheet remembers less than this share of a touch once the fingers have left the object.
_STUCK_SHARE = 0.7
#: An object that one finger pushes lies at most this many steps off the middle.
_PUSHED_STEPS = 5.0
#: One finger pushes alone only if the other feels less than this share of what it feels.
_ALONE_SHARE = 0.3
#: Where the hand first looks again: this far short of where the touch at speed ended, in steps of
#: the approach, or by this multiple of what the force read there takes on a rigid object.
_SHORT_STEPS, _SHORT_OF_FORCE = 0.4, 0.8
#: A movement that is shortened to a safe length is not steady, and an unsteady one reads like a
#: touch.
_HASTE_SHARE = 0.85
#: An expected size may have this error and the hand still touches as gently as without it, mm.
_EXPECTED_MM = 5.0


def sweep_rate(belief: Belief, plan: Plan) -> float:
    """Return how fast the hand may close without knowing where the object is.

    From a touch until it stops it goes two steps of the approach: through the frame in which the
    touch falls, the lag of the sheet, and the latency of the gripper.
    """
    late_s = belief.period_s + _SHEET_LAG_S + plan.safety.latency_s
    return min(_OVERRUN_STEPS * approach_step(plan) / late_s, plan.gripper.fastest)


def begun(belief: Belief, plan: Plan, *, rows: tuple[int, ...] | None = None) -> Belief:
    """Return the belief at the start of a way: near to an expected size, or to the end.

    `rows`: of the pixels that are watched; all by default.
    """
    end, rate = plan.gripper.span, sweep_rate(belief, plan)
    # Once the hand has slowed down, and before the object can be there, it must feel again.
    near = _near(plan) - rate * blind_s(belief.period_s)
    slowed = belief.sweep is not None
    if not slowed and near - belief.closure > approach_step(plan):
        end, rate = near, max(rate, _hasty_rate(belief, plan))
    sweep = Sweep(
        rate=rate,
        begin=belief.closure,
        end=end,
        since_s=belief.now_s,
        slowed=slowed,
        rows=rows,
        most_n=math.inf if rows is None else _most_push_n(belief, plan),
    )
    return replace(belief, sweep=sweep).enter(Phase.SWEEP)


def _hasty_rate(belief: Belief, plan: Plan) -> float:
    """Return how fast the hand may close where nothing is expected yet.

    An expectation may be wrong, so no command goes further than is safe on whatever is there.
    """
    late_s = _command_s(belief, frames=_HASTE_FRAMES) + plan.safety.latency_s
    return min(_HASTE_SHARE * safe_step(belief, plan) / late_s, plan.gripper.fastest)


def _near(plan: Plan) -> float:
    """Return the closure up to which an expected object can't be there yet."""
    if plan.expect_size_mm is None:
        return 0.0
    width_mm = plan.expect_size_mm + _EXPECTED_MM
    if plan.gripper.drive == "width":
        zero_mm = 0.0 if plan.give is None else plan.give.zero_mm
        return plan.gripper.highest - (width_mm + zero_mm)
    if plan.bend is None:
        return 0.0
    return -(width_mm + plan.bend.give.zero_mm) / plan.bend.mm_per_kpa - plan.gripper.lowest


def swept(belief: Belief, plan: Plan) -> tuple[Belief, GripperCommand | None]:
    """Go on closing, a little ahead of where the hand is; stop where something is felt."""
    sweep = belief.sweep
    assert sweep is not None
    # A hand that stands still shakes nothing: its position shows that it did not arrive.
    asleep = sweep.asleep and belief.still_since_s is None
    # With more than a push takes the object is gripped, and the other finger may not show it.
    gripped = belief.watched_n > sweep.most_n
    if sweep.time_s and (asleep or gripped or sweep.touched(plan.current)):
        # No further than it reports to be: a stop is never cut.
        here = whole(belief.closure - belief.behind, plan, within=True)
        stop = GripperCommand(target=here, rate=plan.gripper.fastest)
        return replace(belief, swept_to=belief.closure).enter(Phase.FELT), stop
    near = sweep.end < plan.gripper.span
    ahead = sweep.rate * _command_s(belief, frames=_HASTE_FRAMES if near else _FRAMES)
    if near and belief.closure >= sweep.end - ahead:
        # Before it stops there: that would read like a touch.
        return begun(belief, plan), None
    if belief.closure >= sweep.end - plan.smallest_step:
        return replace(belief, swept_to=belief.closure).enter(Phase.FELT), None
    target = whole(min(belief.closure + ahead, sweep.end), plan)
    further = closure_of(target, plan) > belief.sent + plan.resolution / 2
    # A hand that does not move is sent on now and then, so that it is noticed.
    if not further and belief.now_s - belief.moved_s < _IDLE_S:
        return belief, None
    return belief, GripperCommand(target=target, rate=sweep.rate)


def stood(belief: Belief, plan: Plan) -> tuple[Belief, GripperCommand | None]:
    """Where the way ended, stand and look: a touch of both fingers, of one, or nothing."""
    if belief.still_s < QUIET_S or not belief.touches:
        return belief, None
    assert belief.sweep is not None
    now, went = belief.now, belief.closure - belief.sweep.begin
    belief = replace(belief, sweep=None)
    estimate = plan.early_law.force_n(now.reading, level=plan.level)
    if now.shared_percent > FELT_PERCENT:
        pushes = now.deepest_percent <= FELT_PERCENT
        alone = pushes and now.shared_percent > _ALONE_SHARE * now.deepest_percent
        if alone and float(estimate.value) <= plan.no_push_n and went > approach_step(plan):
            return begun(belief, plan, rows=_unfelt_rows(now, plan)), None
        # Nothing, or one finger alone and no way gained: on in small steps.
        swept_to = belief.closure + (_PUSHED_STEPS * plan.step if pushes else 0.0)
        return replace(belief, swept_to=swept_to).enter(Phase.APPROACH), None
    belief = pressed(belief, force_n=float(estimate.value), force_high_n=float(estimate.high))
    belief = replace(belief, felt_s=belief.moved_s)
    if now.shared_percent <= plan.hint_percent or belief.force_n > plan.no_push_n:
        belief = belief.noted("contact")
    if plan.damage is None and belief.force_n < plan.no_push_n:
        # A touch this gentle is the first step of the squeeze.
        return belief.enter(Phase.APPROACH), None
    met = (belief.closure, belief.force_n)
    belief = replace(belief, met=met, released_s=belief.now_s, memory=None)
    back = approach_step(plan) + 0.5 * plan.step + plan.play
    target = whole(max(belief.closure - back, 0.0), plan)
    return belief.enter(Phase.APPROACH), GripperCommand(target=target, rate=plan.rate)


def _most_push_n(belief: Belief, plan: Plan) -> float:
    """Return the force that is read of one finger alone while it pushes, at most.

    The law of both fingers reads a half of it, once the one finger surely feels something.
    """
    faint = belief.now.deepest_percent > plan.hint_percent
    return plan.no_push_n if faint else 0.5 * plan.no_push_n


def look_again(belief: Belief, plan: Plan) -> float:
    """Return the closure where a hand that went back looks first: close to what it met.

    Up to there the object has borne more already.
    """
    if belief.met is None:
        return -math.inf
    closure, force_n = belief.met
    short = max(_SHORT_OF_FORCE * force_n / plan.steepest_n, _SHORT_STEPS * approach_step(plan))
    return closure - short


def _unfelt_rows(now: Touch, plan: Plan) -> tuple[int, ...]:
    """Return the rows of pixels on fingers that feel nothing: where the next touch will come.

    One finger alone pushes the object to the middle, and its own pixels change on the way.
    """
    felt = np.array(now.finger_percent) <= FELT_PERCENT
    return tuple(np.flatnonzero(~felt[list(plan.layout.finger_of_row)]).tolist())


def unreleased(belief: Belief, plan: Plan) -> bool:
    """Whether a hand that went back as far as it may still reads most of the touch.

    No sheet remembers that much: what it reads has nothing to do with the fingers.
    """
    if belief.still_s < plan.dwell_s or belief.now.shared_percent > plan.hint_percent:
        return False
    left_n = float(plan.early_law.force_n(belief.now.reading).value)
    return not _may_go_back(belief, plan) and left_n > _STUCK_SHARE * belief.force_n


def _may_go_back(belief: Belief, plan: Plan) -> bool:
    """Whether a hand that still feels the touch goes back further."""
    back = _FURTHER_BACK_STEPS * plan.step
    return belief.closure > max(belief.swept_to - back, plan.step)


def remembered(belief: Belief, plan: Plan) -> tuple[Belief, GripperCommand | None]:
    """Where the hand came back to nothing is held: what is read there is the sheet's memory.

    Where both fingers read more than a hint, it has not come back far enough.
    """
    if belief.still_s < plan.dwell_s:
        return belief, None
    if belief.now.shared_percent <= plan.hint_percent and _may_go_back(belief, plan):
        target = whole(max(belief.closure - plan.step, 0.0), plan)
        return belief, GripperCommand(target=target, rate=plan.rate)
    nothing = plan.early_law.force_n(0.0, level=plan.level)
    stairs = tuple(stair for stair in belief.staircase if stair.closure < belief.closure)
    free = replace(belief, memory=_fall(belief.now), touches=(), staircase=stairs)
    return pressed(free, force_n=0.0, force_high_n=float(nothing.high)), None


def _fall(now: Touch) -> Touch:
    """Return what of a touch is a fall: a rise is the movement's, and fades by itself."""
    return Touch(
        time_s=now.time_s,
        finger_percent=tuple(min(percent, 0.0) for percent in now.finger_percent),
        relative_percent=min(now.relative_percent, 0.0),
        reading=max(now.reading, 0.0),
    )


def _command_s(belief: Belief, *, frames: float) -> float:
    """Return how far ahead a command of the way reaches, in time."""
    return frames * belief.period_s + _AHEAD_S
