"""Rest values of a grasp: measured again each time, unless something presses already.

The sheet drifts with climate and wear. But what presses at the start must not be zeroed away, and
a sheet that weather made more conductive reads as if something pressed. Closing on distinguishes
the two: where something is between the fingers the reading rises with the next millimetres, on
a sheet that only drifted it does not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.signal.relative import rest_baseline

#: A hand that touches the sheet, or a sheet that recovers, has this long to come to rest, seconds.
_PATIENCE_S = 3.0
#: Weather and wear move a sheet's rest by less than this factor, all pixels alike, and single
#: pixels by less than this one against the others: what lies beyond is no rest of this sheet.
_SHEET_FACTOR, _PIXEL_FACTOR = 2.5, 1.6
#: Closing over this many steps of the approach without a rise shows that nothing presses.
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


def strange_rest(rest_ohm: FloatArray, *, plan: Plan) -> str | None:
    """Return why rest values can't be this sheet's, whatever the weather; None if they can.

    They are compared with the calibration's: the median over the pixels, then each pixel.

    >>> from types import SimpleNamespace
    >>> plan = SimpleNamespace(rest_ohm=np.array([[9e3, 8e3, 7e3]]))
    >>> strange_rest(np.array([[6e3, 5e3, 5e3]]), plan=plan)
    >>> strange_rest(np.array([[20.0, 20.0, 20.0]]), plan=plan)[:36]
    'the sheet at rest reads 0.0025 times'
    """
    ratio = np.asarray(rest_ohm) / np.asarray(plan.rest_ohm)
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    if not ratio.size:
        return None
    shared = float(np.median(ratio))
    if not 1.0 / _SHEET_FACTOR < shared < _SHEET_FACTOR:
        return (
            f"the sheet at rest reads {shared:.2g} times the calibration's resistance, and weather "
            f"or wear move it by less than a factor of {_SHEET_FACTOR:g}; run `palpate doctor`"
        )
    apart = float(np.exp(np.abs(np.log(ratio / shared)).max()))
    if apart < _PIXEL_FACTOR:
        return None
    return (
        f"a pixel at rest has moved by a factor of {apart:.2g} against the others since the "
        f"calibration, and weather or wear move them alike; run `palpate doctor`"
    )


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
    return replace(belief.with_fault(note), proving_from=None)


def _with_old_values(belief: Belief, why: str, *, plan: Plan) -> Belief:
    belief = belief.with_fault(f"rest values of the calibration used: {why}")
    return replace(belief, rest_ohm=plan.rest_ohm, rest_frames=())
