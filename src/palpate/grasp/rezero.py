"""Rest values of a grasp: taken anew each time, unless something presses already.

The sheet drifts with climate and wear. But what presses at the start must not be zeroed away, and
a sheet that weather made more conductive reads as if something pressed. The two are told apart by
closing on: where something is between the fingers the reading rises with the next millimetres, on
a sheet that only drifted it does not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.errors import CalibrationError
from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.signal.relative import rest_baseline

#: A hand that touches the sheet, or a sheet that recovers, gets so long to come to rest, seconds.
_PATIENCE_S = 3.0
#: Closing over so many steps of the approach without a rise shows that nothing presses.
_PROVING_STEPS = 1.5


def rezeroed(belief: Belief, *, plan: Plan) -> Belief:
    """Take the rest values from the frames before the first movement, if they are a rest.

    If they are none, newer frames are waited for. After that, frames that move give way to the
    calibration's values; and where steady ones lie far below those, the closing has to show that
    nothing presses (`proved`). Without rest values the belief is one that still waits.
    """
    frames = np.array(belief.rest_frames)
    try:
        rest = rest_baseline(frames, known_ohm=plan.rest_ohm)
    except CalibrationError as refused:
        waited_s = min(belief.now_s - belief.since_s, belief.lasted_s)
        if waited_s < plan.rest_s + _PATIENCE_S:
            return replace(belief, rest_frames=(), still_since_s=belief.now_s)
        return _unsure(belief, refused, plan=plan)
    return replace(belief, rest_ohm=rest.rest_ohm, rest_frames=())


def _unsure(belief: Belief, refused: CalibrationError, *, plan: Plan) -> Belief:
    try:
        rest = rest_baseline(np.array(belief.rest_frames))
    except CalibrationError:
        return _with_old_values(belief, str(refused), plan=plan)
    return replace(belief, rest_ohm=rest.rest_ohm, rest_frames=(), proving_from=belief.closure)


def proved(belief: Belief, *, plan: Plan) -> Belief:
    """Decide whether the steady frames before closing were a rest, once closing has shown it."""
    assert belief.proving_from is not None
    if belief.now.deepest_percent <= plan.hint_percent:
        why = "the reading rose as soon as the fingers closed: something pressed before"
        old = _with_old_values(belief, why, plan=plan)
        return replace(old, proving_from=None, staircase=(), touches=(), contact_s=None)
    if belief.closure - belief.proving_from < _PROVING_STEPS * plan.step:
        return belief
    note = (
        "rest values are far below the calibration's, yet nothing presses: weather or wear moved "
        "the sheet; `palpate calibrate rest --empty` keeps the new ones"
    )
    result = replace(belief.result, faults=(*belief.result.faults, note))
    return replace(belief, proving_from=None, result=result)


def _with_old_values(belief: Belief, why: str, *, plan: Plan) -> Belief:
    faults = (*belief.result.faults, f"rest values of the calibration used: {why}")
    result = replace(belief.result, faults=faults)
    return replace(belief, rest_ohm=plan.rest_ohm, rest_frames=(), result=result)
