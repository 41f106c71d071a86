"""What the controller makes of a grasp, for people: its forecast, and what it would answer now."""

from __future__ import annotations

import math
from dataclasses import replace

from palpate.dashboard.grip_force import ContactGains, settled_gain
from palpate.dashboard.messages import Bounds, Thought
from palpate.estimate.gain import Gain
from palpate.estimate.measurement import Measurement
from palpate.grasp.answer import Settled, answered, forecast
from palpate.grasp.belief import Belief
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan

_FORECAST_IN = (Phase.SETTLE, Phase.ADJUST, Phase.HOLD)
#: Before these, a first answer may be corrected by another movement.
_DECIDED_IN = (Phase.HOLD, Phase.RELEASE, Phase.STOPPED)
#: A forecast from fewer touches than this is noise; with more than that, every other will do.
_FEWEST, _MOST = 4, 200


def thought_of(belief: Belief, *, plan: Plan, before: Thought | None, forecasts: bool) -> Thought:
    """Return what is to be shown of a belief.

    The forecast is the controller's own function on the controller's own touches, so the band on
    the page is the one that it decides by. It goes on after the decision, while the hand holds.

    Parameters
    ----------
    belief : Belief
        After the newest frame.
    plan : Plan
        The grasp's.
    before : Thought or None
        What was shown last: its forecast stands until there is a newer one.
    forecasts : bool
        Whether to make a new one now; it costs milliseconds.
    """
    decided = belief.result.force_n is not None and belief.phase in _DECIDED_IN
    settled = settled_n = of_settled = None
    answer = belief.result
    if before is not None and belief.phase in (*_FORECAST_IN, Phase.RELEASE, Phase.STOPPED):
        settled, settled_n = before.settled, before.settled_n
        of_settled = before.gains.settled
        answer = belief.result if decided else before.answer
    if forecasts and belief.phase in _FORECAST_IN and len(belief.touches) >= _FEWEST:
        every = len(belief.touches) // _MOST + 1
        # From the end: the newest touch is always among them.
        thinned = replace(belief, touches=belief.touches[::-every][::-1])
        foreseen = forecast(thinned, plan=plan)
        would_answer = answered(thinned, foreseen, plan=plan).result
        settled, settled_n = foreseen.relative_percent, would_answer.force_n
        of_settled = _settled_gain(settled_n, foreseen, plan)
        answer = belief.result if decided else would_answer
    return Thought(
        time_s=belief.now_s,
        phase=str(belief.phase),
        rest_ohm=belief.rest_ohm,
        began_s=belief.began_s or 0.0,
        force_n=belief.force_n,
        settled=settled,
        answer=answer,
        decided=decided,
        settled_n=settled_n,
        gains=ContactGains(early=_early_gain(belief), settled=of_settled),
        touched_s=_touched_s(belief),
        moments=belief.result.moments,
        bounds=_bounds(belief, plan),
    )


def _early_gain(belief: Belief) -> Gain | None:
    """Return how the closing read so far; before its first step nothing is known."""
    return belief.gain if belief.gain.log_sd > 0 else None


def _settled_gain(force: Measurement | None, foreseen: Settled, plan: Plan) -> Gain | None:
    if force is None:
        return None
    law_n = float(plan.settled_law.force_n(foreseen.reading.value).value)
    return settled_gain(force, law_n=law_n, law=plan.settled_law)


def _touched_s(belief: Belief) -> float | None:
    """Return from when the answer's time is counted, once the contact is noted."""
    if not any(moment.name == "contact" for moment in belief.result.moments):
        return None
    return belief.felt_s if belief.felt_s is not None else belief.contact_s


def _bounds(belief: Belief, plan: Plan) -> Bounds:
    limit_n = belief.damage_low_n
    return Bounds(
        target_n=plan.target_force_n,
        damage_low_n=limit_n if math.isfinite(limit_n) else None,
        ceiling_n=plan.safety.force_ceiling_n,
    )
