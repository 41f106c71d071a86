"""Rest values of a grasp: measured again each time, unless something presses already.

The sheet drifts with climate and wear. But what presses at the start must not be zeroed away, and
a sheet with more conductance in heat or humidity reads as if loaded. Closing on distinguishes
the two: where something is between the fingers the reading rises with the next millimetres, on
a sheet that only drifted it does not.
"""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.grasp.config import GUARDS
from palpate.grasp.plan import Plan
from palpate.grasp.state import GraspState
from palpate.signal.relative import rest_baseline


def measure_rest(state: GraspState, *, plan: Plan) -> bool:
    """Take the rest values from frames before the first movement; return whether any exist.

    If those are no rest, newer frames are waited for. After that, moving frames are replaced by the
    calibration's values; and where steady ones lie far below those, the closing has to show that
    nothing presses (`verify_rest`).
    """
    estimate, now = state.estimate, state.estimate.now_s
    if estimate.still_s < plan.rest_s or len(estimate.rest_frames) < plan.rest_frames:
        return False
    frames = np.array(estimate.rest_frames)
    try:
        estimate.rest_ohm = rest_baseline(frames, known_ohm=plan.rest_ohm).rest_ohm
    except CalibrationError as refused:
        waited_s = min(state.elapsed_s, estimate.duration_s)
        if waited_s < plan.rest_s + GUARDS.patience_s:
            estimate.rest_frames, estimate.still_since_s = (), now
            return False
        try:
            estimate.rest_ohm = rest_baseline(frames).rest_ohm
            state.attempt.rest_check_from = estimate.closure
        except CalibrationError:
            _use_old_values(state, str(refused), plan=plan)
    estimate.rest_frames = ()
    return True


def explain_implausible_rest(rest_ohm: FloatArray, *, plan: Plan) -> str | None:
    """Return why rest values can't be this sheet's, in any climate; None if they can.

    They are compared with the calibration's: the median over the pixels, then each pixel.

    >>> from types import SimpleNamespace
    >>> plan = SimpleNamespace(rest_ohm=np.array([[9e3, 8e3, 7e3]]))
    >>> explain_implausible_rest(np.array([[6e3, 5e3, 5e3]]), plan=plan)
    >>> explain_implausible_rest(np.array([[20.0, 20.0, 20.0]]), plan=plan)[:36]
    'the sheet at rest reads 0.0025 times'
    """
    ratio = np.asarray(rest_ohm) / np.asarray(plan.rest_ohm)
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    if not ratio.size:
        return None
    shared = float(np.median(ratio))
    if not 1.0 / GUARDS.sheet_factor < shared < GUARDS.sheet_factor:
        return (
            f"the sheet at rest reads {shared:.2g} times the calibration's resistance, and climate "
            f"or wear move it by less than a factor of {GUARDS.sheet_factor:g}; run `palpate "
            "doctor`"
        )
    apart = float(np.exp(np.abs(np.log(ratio / shared)).max()))
    if apart < GUARDS.pixel_factor:
        return None
    return (
        f"a pixel at rest has moved by a factor of {apart:.2g} against the others since the "
        f"calibration, and climate or wear move them alike; run `palpate doctor`"
    )


def verify_rest(state: GraspState, rest_check_from: float, *, plan: Plan) -> bool:
    """Decide whether the steady frames before closing were a rest, once closing has shown it.

    Returns whether what was read since still counts.
    """
    estimate = state.estimate
    if estimate.now.strongest_percent <= plan.hint_percent:
        why = "the reading rose as soon as the fingers closed: something pressed before"
        _use_old_values(state, why, plan=plan)
        estimate.steps, estimate.touches, estimate.contact_s = (), (), None
        state.attempt.rest_check_from = None
        return False
    if estimate.closure - rest_check_from >= plan.step:
        state.add_fault(
            "rest values are far below the calibration's, yet nothing presses: climate or wear "
            "moved the sheet; `palpate calibrate rest --empty` keeps the new ones"
        )
        state.attempt.rest_check_from = None
    return True


def _use_old_values(state: GraspState, why: str, *, plan: Plan) -> None:
    state.add_fault(f"the calibration's rest values are used: {why}")
    state.estimate.rest_ohm = plan.rest_ohm
