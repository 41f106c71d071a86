"""How far to close next: what the last steps taught, and what is safe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate.estimate.closing_stiffness import FELT
from palpate.estimate.measurement import Measurement
from palpate.grasp.answer import FELT_PERCENT, floor_n, measured_stiffness
from palpate.grasp.belief import Belief, Closing
from palpate.grasp.plan import Plan
from palpate.grasp.safety import DAMAGE_RATE, largest_step
from palpate.grasp.servo_evidence import early_gain
from palpate.gripper.interface import GripperCommand

#: Room for stiffening over a step beyond what the last steps showed.
_STIFFENING = 1.3
#: No step may bring the force above this multiple of the target and this more, newtons, by the
#: slope that is believed (a requirement: a grasp that presses harder can bruise).
_MOST_OF_TARGET, _MOST_BEYOND_N = 1.5, 0.5
#: A rise that is less than this, newtons, or than this share of the force, or of the calibration's
#: scatter of faint forces, may be noise (guess: a sheet at rest scatters by 0.05 to 0.1 N, and
#: its readings under load repeat to 3 %).
_SURE_N, _SURE_SHARE, _SURE_OF_FLOOR = 0.15, 0.05, 0.5
#: Share of the way pressed so far that a step may add, beyond a fine one.
_FURTHER = 1.2
#: While nothing is known of the damage limit, all steps after the first force that can't be drift
#: may together add this much, newtons, on an object as soft as ripe fruit.
_UNKNOWN_N, _SOFT_N_PER_MM = 0.3, 0.7
#: Share of the room to the damage limit that one step may take.
_SHARE_OF_ROOM = 0.8
#: A step in which the servo's current is used lasts for this many frames, and at least this long.
_FELT_FRAMES, _FELT_S = 3.0, 0.1
#: Steps that differ by less, mm or kPa (or whole steps of a drive), differ by arithmetic only.
_EXACT = 1e-9
#: Share of the force missing to the target that one step of the squeeze may add.
_BOLD = 0.75
#: Share of a step of the squeeze that is left once the force is there.
_BEYOND = 0.5


def approach_step(plan: Plan) -> float:
    """Return the step before contact: such that not even a rigid object gets more than the target.

    Where a damage limit is sought it is half as long: a sheet feels nothing of a faint force, and a
    weak thing may not bear what the last step adds to that. Without a target it is the plan's.
    """
    if plan.target_force_n is None:
        return plan.step
    afforded = plan.target_force_n / plan.steepest_n
    longest = plan.step if plan.damage is None else 0.5 * plan.step
    return min(max(afforded, plan.fine_step), longest)


def read(belief: Belief, plan: Plan) -> Belief:
    """Read the force now and its upper bound; a step that is read for the first time is a stair.

    Read again later, the sheet has crept: the early law would call that force. Where the hand came
    back to, the sheet remembers more.
    """
    touch, stairs = belief.now, belief.staircase
    read_before = stairs and belief.moved_s < stairs[-1].touch.time_s
    if read_before or (stairs and belief.closure <= stairs[-1].closure):
        return belief
    stairs = (*stairs, Closing(closure=belief.closure, touch=touch))
    belief = replace(belief, staircase=stairs)
    belief = replace(belief, gain=early_gain(belief, plan))
    force = belief.gain.applied(plan.early_law.force_n(touch.reading, level=plan.level))
    belief = pressed(belief, force_n=float(force.value), force_high_n=float(force.high))
    return replace(belief, damage_low_n=_damage_low_n(belief, plan))


def force_now(belief: Belief, plan: Plan) -> Measurement:
    """Return the force of the last step read, as the sheet reads it soon after."""
    return Measurement(
        value=belief.force_n,
        low=belief.force_n**2 / belief.force_high_n,
        high=belief.force_high_n,
        unit="n",
        level=plan.level,
    )


def pressed(belief: Belief, *, force_n: float, force_high_n: float) -> Belief:
    """Return the belief with another force now."""
    peak_n = max(belief.peak_force_n, force_n)
    return replace(belief, force_n=force_n, force_high_n=force_high_n, peak_force_n=peak_n)


def closed_by(
    belief: Belief, step: float, plan: Plan, *, lasting_s: float = 0.0
) -> GripperCommand | None:
    """Return the wish to close by a step; None if what is safe of it is not worth a movement.

    A servo whose current is listened to takes at least `lasting_s` for it, and some frames.
    """
    step = min(step, _step_to_bound(belief, plan))
    if step < plan.smallest_step:
        return None
    rate = plan.rate if belief.contact_s is None else plan.squeeze_rate
    if belief.contact_s is not None and plan.current is not None:
        frames_s = _FELT_FRAMES * belief.period_s
        rate = min(rate, step / max(lasting_s, frames_s, _FELT_S))
    wish = GripperCommand(target=whole(belief.closure + step, plan), rate=rate)
    return None if clamped(belief, wish, plan) is None else wish


def _step_to_bound(belief: Belief, plan: Plan) -> float:
    """Return how far closing may go on before the force could be far above the target."""
    if plan.target_force_n is None or not belief.force_n > 0:
        return math.inf
    target_n = max(plan.target_force_n, plan.lift_force_n or 0.0)
    room_n = _MOST_OF_TARGET * target_n + _MOST_BEYOND_N - belief.force_n
    return max(room_n, 0.0) / slope_high_n(belief, plan)


def clamped(belief: Belief, wish: GripperCommand | None, plan: Plan) -> GripperCommand | None:
    """Return what is safe of a wish; None where that is no movement. An opening is never cut.

    What is cut takes as long as the wish would have: it comes more slowly, and so overruns less.
    """
    if wish is None or closure_of(wish.target, plan) <= belief.closure:
        return wish
    way = min(closure_of(wish.target, plan), plan.gripper.span) - belief.closure
    overrun = wish.rate * plan.safety.latency_s / way if way > 0 else 0.0
    room = min(safe_step(belief, plan) / (1.0 + overrun), _unknown_step(belief, plan))
    target = plan.gripper.target(belief.closure + way)
    if way > room + _EXACT:
        target = whole(belief.closure + room, plan, within=True)
    cut = closure_of(target, plan) - belief.closure
    if cut < plan.smallest_step - _EXACT:
        return None
    return GripperCommand(target=target, rate=wish.rate * min(cut / way, 1.0))


def safe_step(belief: Belief, plan: Plan) -> float:
    """Return how far the hand may close on whatever it meets, from where it reports to be."""
    safe = largest_step(
        force_high_n=belief.force_high_n,
        steepest_n=plan.steepest_n,
        rate=0.0,
        damage_low_n=belief.damage_low_n,
        limits=plan.safety,
    )
    return safe - belief.behind


def whole(closure: float, plan: Plan, *, within: bool = False) -> float:
    """Return the target of a closure in whole steps of the drive: the nearest, or none further.

    A gripper would round it itself, but then a replay would not know.
    """
    steps = plan.gripper.target(closure) / plan.resolution
    if not within:
        return round(steps) * plan.resolution
    outward = (
        math.ceil(steps - _EXACT) if plan.gripper.drive == "width" else math.floor(steps + _EXACT)
    )
    return outward * plan.resolution


def closure_of(target: float, plan: Plan) -> float:
    """Return the closure of a target."""
    return abs(target - plan.gripper.target(0.0))


def sent_to(belief: Belief, target: float, plan: Plan) -> Belief:
    """Return the belief of a hand on its way."""
    return replace(
        belief,
        still_since_s=None,
        touches=(),
        moved_s=belief.now_s,
        sent=closure_of(target, plan),
    )


def wanted_step(belief: Belief, plan: Plan, *, goal_n: float) -> float:
    """Return the step that should raise the force by a fixed amount, or by more far from the goal.

    The first steps after a touch are fine, and none goes much further than the fingers have pressed
    already: how steeply the force rises is known only as far as it was felt.
    """
    rise_n = max(plan.force_step_n, _BOLD * (goal_n - belief.force_n))
    if 0.0 < goal_n < belief.force_n:
        # Beyond the goal a step is only there to be read.
        rise_n *= _BEYOND
    longest = _FURTHER * squeezed(belief, plan) + plan.fine_step
    if gentle(plan):
        left_mm = plan.gentle_mm - deformed_mm(belief, plan)
        longest = min(longest, max(left_mm / mm_per_unit(plan), plan.fine_step))
    if belief.met is not None:
        # It has borne more already.
        longest = max(longest, belief.met[0] - belief.closure)
    wanted = max(min(rise_n / slope_high_n(belief, plan), longest), plan.smallest_step)
    if _unmoved(belief):
        wanted = max(wanted, 0.5 * plan.step)
    if plan.damage is None:
        return wanted
    if math.isinf(belief.damage_low_n):
        # A limit needs two steps that are surely felt, and there is little room to take them in.
        return min(wanted, plan.fine_step)
    # The limit is measured again at every step: it is approached in several.
    room_n = belief.damage_low_n - belief.force_high_n
    return min(wanted, _SHARE_OF_ROOM * room_n / slope_high_n(belief, plan))


def _unmoved(belief: Belief) -> bool:
    """Whether the last step was none: a coarse drive rounded it to where it was."""
    last = belief.staircase[-1]
    return belief.moved_s > last.touch.time_s and belief.closure <= last.closure


def squeezed(belief: Belief, plan: Plan) -> float:
    """Return how far the hand has closed since it grips the object, mm or kPa.

    From where the force began, by how steeply it rises. A faint touch of one finger alone is no
    squeeze, it may only push.
    """
    force_n = _forces_n(belief.staircase, belief, plan)
    gripped = [_is_gripped(*pair, plan) for pair in zip(belief.staircase, force_n, strict=True)]
    if not any(gripped):
        return 0.0
    first = gripped.index(True)
    way = belief.closure - belief.staircase[first].closure
    return float(way + max(force_n[first], 0.0) / slope_n(belief, plan))


def gentle(plan: Plan) -> bool:
    """Whether the squeeze is only there to measure: it is after no force, and lifts nothing."""
    return plan.target_force_n is None and plan.lift_force_n is None


def deformed_mm(belief: Belief, plan: Plan) -> float:
    """Return how far the object has given way: the squeeze without what the hand gives way."""
    way_mm = squeezed(belief, plan) * mm_per_unit(plan)
    give = plan.give if plan.bend is None else plan.bend.give
    return way_mm if give is None else way_mm - float(give.give_mm(belief.force_n))


def mm_per_unit(plan: Plan) -> float:
    """Return how far the fingers close for a unit of the drive, mm per mm or kPa."""
    return 1.0 if plan.bend is None else plan.bend.mm_per_kpa


def _unknown_step(belief: Belief, plan: Plan) -> float:
    """Return how far closing may go on while nothing is known of the damage limit.

    Counted from the first force that can't be drift: below it no step teaches anything of a limit.
    One finger that feels a little alone only pushes the object to the middle: that is no squeeze.
    """
    if plan.damage is None or not math.isinf(belief.damage_low_n):
        return math.inf
    force_n = _forces_n(belief.staircase, belief, plan)
    shared = np.array([stair.touch.shared_percent for stair in belief.staircase])
    both = (shared <= FELT_PERCENT) | (force_n > plan.no_push_n)
    felt = both & (force_n > FELT * floor_n(plan))
    if not felt.any():
        return math.inf
    longest = _UNKNOWN_N * (1.0 / plan.steepest_n + 1.0 / (_SOFT_N_PER_MM * mm_per_unit(plan)))
    return belief.staircase[int(np.argmax(felt))].closure + longest - belief.closure


def slope_high_n(belief: Belief, plan: Plan) -> float:
    """Return how steeply the force may rise: as the last steps saw, with room for stiffening."""
    return min(_STIFFENING * slope_n(belief, plan), plan.steepest_n)


def slope_n(belief: Belief, plan: Plan) -> float:
    """Return how steeply the force rises, N per mm or kPa: as it did over the last steps.

    Short of where the hand met the object at speed it is no less than the force there shows. A rise
    that noise alone could make shows no slope, nor does one that began on the way. Without any the
    object may be rigid, and so it may where the sheet shows less for more closing.
    """
    last = belief.staircase[-3:]
    curve = list(zip(last, _forces_n(last, belief, plan).tolist(), strict=True))
    if len(curve) > 1 and plan.force_step_n < curve[-1][1] < curve[-2][1]:
        return plan.steepest_n
    slopes = [
        (f1 - f0) / (c1.closure - c0.closure)
        for (c0, f0), (c1, f1) in pairwise(curve)
        if c1.closure > c0.closure and f1 - f0 >= _sure_n(f1, plan) and _is_gripped(c0, f0, plan)
    ]
    if belief.met is not None and curve:
        (closure, met_n), (now, now_n) = belief.met, curve[-1]
        if closure > now.closure and met_n > now_n:
            slopes.append((met_n - now_n) / (closure - now.closure))
    if not slopes:
        return _slope_bound_n(belief, plan)
    return float(min(max(slopes), plan.steepest_n))


def _is_gripped(stair: Closing, force_n: float, plan: Plan) -> bool:
    """Return whether both fingers surely pressed at a step."""
    return stair.touch.shared_percent <= plan.hint_percent or force_n > plan.force_step_n


def _sure_n(force_n: float, plan: Plan) -> float:
    """Return the rise to this force that noise alone does not make, newtons."""
    return max(_SURE_OF_FLOOR * floor_n(plan), _SURE_N, _SURE_SHARE * force_n)


def _slope_bound_n(belief: Belief, plan: Plan) -> float:
    """Return the steepest slope that steps without a sure rise leave possible, N per mm or kPa."""
    force_n = _forces_n(belief.staircase, belief, plan)
    felt = np.flatnonzero(force_n > FELT * floor_n(plan))
    way = belief.staircase[-1].closure - belief.staircase[felt[0]].closure if felt.size else 0.0
    if way < plan.smallest_step:
        return plan.steepest_n
    return min(belief.force_high_n / way, plan.steepest_n)


def _damage_low_n(belief: Belief, plan: Plan) -> float:
    """Return the lower bound of the damage limit, estimated from the closing so far.

    Force and limit are read by one gain: where the force is less than it seems, so is the limit. So
    the bound is given as the largest gain reads forces, because the upper force is given so too.

    For a thing that stiffens, the hand measures a smaller slope than the one that the model learned
    from, because it counts from the first touch: that errs to the safe side.
    """
    if plan.damage is None or not belief.force_n > 0:
        return math.inf
    stiffness = measured_stiffness(belief, force_now(belief, plan), plan=plan)
    if stiffness is None:
        return math.inf
    reach = float(ndtri(0.5 + plan.level / 2)) * belief.gain.log_sd
    return math.exp(reach) * plan.damage.bound_n(stiffness, kind=plan.kind, rate=DAMAGE_RATE)


def _forces_n(stairs: Sequence[Closing], belief: Belief, plan: Plan) -> NDArray[np.float64]:
    """Return the forces of steps, soon after each, by the sheet and this contact's gain."""
    estimate = plan.early_law.force_n(np.array([stair.touch.reading for stair in stairs]))
    return np.asarray(math.exp(belief.gain.log_mean) * estimate.value)
