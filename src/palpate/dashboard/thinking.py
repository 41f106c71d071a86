"""What the controller makes of a grasp, for people: its forecast, and what it would answer now."""

from __future__ import annotations

from dataclasses import replace

from palpate.dashboard.messages import Thought
from palpate.grasp.answer import answered, forecast
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
    settled = None if before is None else before.settled
    answer = belief.result if decided or before is None else before.answer
    if belief.phase not in (*_FORECAST_IN, Phase.RELEASE, Phase.STOPPED):
        settled, answer = None, belief.result
    elif forecasts and belief.phase in _FORECAST_IN and len(belief.touches) >= _FEWEST:
        every = len(belief.touches) // _MOST + 1
        # From the end: the newest touch is always among them.
        thinned = replace(belief, touches=belief.touches[::-every][::-1])
        foreseen = forecast(thinned, plan=plan)
        settled = foreseen.relative_percent
        answer = belief.result if decided else answered(thinned, foreseen, plan=plan).result
    return Thought(
        time_s=belief.now_s,
        phase=str(belief.phase),
        rest_ohm=belief.rest_ohm,
        began_s=belief.began_s or 0.0,
        force_n=belief.force_n,
        settled=settled,
        answer=answer,
        decided=decided,
    )
