"""Corrections of the settled force: up by what is missing, down and back from below."""

from __future__ import annotations

import math
from dataclasses import replace

from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.grasp.step_size import closed_by, pressed, slope_n, whole
from palpate.gripper.interface import GripperCommand

#: An object that relaxes presses a little harder now than when settled.
_STILL_RELAXING = 1.03
#: How much less steep the force may turn out in a correction than the squeeze showed.
_LESS_STEEP = 4.0
#: Share of the goal by which the hand opens below it before it comes back.
_EASED_SHARE = 0.3
#: A correction lasts this long where the servo's current is used: more frames than in a step of the
#: squeeze, because it is made near the target.
_CORRECTED_S = 0.5


def pressed_on(
    belief: Belief, plan: Plan, *, missing_n: float
) -> tuple[Belief, GripperCommand | None]:
    """Close by what raises the settled force by as much as is missing."""
    step = missing_n / _corrected_slope_n(belief, plan)
    step = max(min(step, _fruitless(belief)), plan.smallest_step)
    moved = _settled(belief)
    wish = closed_by(moved, step, plan, lasting_s=_CORRECTED_S)
    corrected = (belief.closure, moved.force_n)
    return replace(
        moved, adjustments=belief.adjustments + 1, next_forecast_s=0.0, corrected=corrected
    ), wish


def _corrected_slope_n(belief: Belief, plan: Plan) -> float:
    """Return how steeply the settled force rises: less than the last steps saw, if it has shown so.

    Faint steps may have looked far too steep; one correction that fell short is not believed
    wholly either.
    """
    slope, force = slope_n(belief, plan), belief.result.force_n
    if belief.corrected is None or force is None:
        return slope
    closure, force_n = belief.corrected
    way = belief.closure - closure
    if not way > 0:
        return slope
    return min(slope, max((force.middle - force_n) / way, slope / _LESS_STEEP))


def _fruitless(belief: Belief) -> float:
    """Return the last correction if it raised nothing: the next one goes no further than that."""
    force = belief.result.force_n
    if belief.corrected is None or force is None or force.middle > belief.corrected[1]:
        return math.inf
    way = belief.closure - belief.corrected[0]
    return way if way > 0 else math.inf


def eased(belief: Belief, plan: Plan, *, goal_n: float) -> tuple[Belief, GripperCommand]:
    """Open well beyond where the force will be what it should, to come back from below.

    The sheet's answer to unloading was not calibrated, nor the play of the gears.
    """
    belief = _settled(belief)
    slope, over_n = slope_n(belief, plan), belief.force_n - goal_n
    again = belief.closure - max(over_n / slope, plan.smallest_step)
    opened = max(again - _EASED_SHARE * goal_n / slope - plan.play, 0.0)
    share = (1.0 - _EASED_SHARE) * goal_n / belief.force_n
    belief = pressed(
        belief, force_n=share * belief.force_n, force_high_n=share * belief.force_high_n
    )
    belief = replace(belief, again=again, adjustments=belief.adjustments + 1, next_forecast_s=0.0)
    return belief, GripperCommand(target=whole(opened, plan), rate=plan.squeeze_rate)


def come_back(belief: Belief, plan: Plan) -> tuple[Belief, GripperCommand | None]:
    """Close again from below, as every force that the sheet was calibrated with was reached.

    At once where that is safe, else in several steps. On its way up the sheet remembers more than
    there is, so what it reads bounds the force.
    """
    way = belief.again - belief.closure
    if way < plan.smallest_step or not belief.touches:
        return belief, None
    read = belief.gain.applied(plan.early_law.force_n(belief.now.reading, level=plan.level))
    belief = pressed(belief, force_n=float(read.value), force_high_n=float(read.high))
    return belief, GripperCommand(target=whole(belief.again, plan), rate=way / _CORRECTED_S)


def _settled(belief: Belief) -> Belief:
    """Return the belief with the settled force as that of now: the early law is for quick steps."""
    force = belief.result.force_n
    if force is None:
        return belief
    now = _STILL_RELAXING
    return pressed(belief, force_n=now * force.middle, force_high_n=now * force.high)
