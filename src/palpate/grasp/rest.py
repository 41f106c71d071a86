"""Rest values of a grasp, measured before each approach unless the sheet is already loaded.

The sheet drifts with climate and wear, and heat or humidity can resemble a load. A load at the
start must not be mistaken for rest. Closing distinguishes the two: a load rises within the next
millimetres, and drift does not.
"""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.grasp.config import GUARDS, READING
from palpate.grasp.plan import Plan
from palpate.grasp.state import GraspState
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import SampleReader


def measure_rest(state: GraspState, *, plan: Plan) -> bool:
    """Measure the rest values before the first movement; return whether they are available.

    If the frames are not at rest, newer frames are awaited. After the timeout, unsteady frames are
    replaced by the calibration's values. Steady frames far below the calibration's values are used,
    and `verify_rest` checks during closing that the sheet was unloaded.
    """
    estimate, now = state.estimate, state.estimate.now_s
    if estimate.still_s < plan.rest_s or len(estimate.rest_frames) < READING.rest_frames:
        return False
    frames = np.array(estimate.rest_frames)
    try:
        estimate.rest_ohm = rest_baseline(frames, known_ohm=plan.rest_ohm).rest_ohm
    except CalibrationError as refused:
        waited_s = min(state.phase_time_s, estimate.duration_s)
        if waited_s < plan.rest_s + GUARDS.patience_s:
            estimate.rest_frames, estimate.still_since_s = (), now
            return False
        try:
            estimate.rest_ohm = rest_baseline(frames).rest_ohm
            state.attempt.rest_check_from = estimate.closure
        except CalibrationError:
            _use_old_values(state, str(refused), plan=plan)
    # Read with the calibration's values, the frames may show a load.
    if estimate.rest_ohm is not None and estimate.rest_ohm is not plan.rest_ohm:
        estimate.rest_force_n = _read_rest_force(frames, estimate.rest_ohm, plan=plan)
    estimate.rest_frames = ()
    return True


def _read_rest_force(frames: FloatArray, rest_ohm: FloatArray, *, plan: Plan) -> float:
    """Return the force that half of the frames at rest exceed, N; it consists of their noise.

    A pixel's noise reads as load in half of the frames, and as nothing in the others, so the sum
    over many pixels does not average out.
    """
    excess = SampleReader(plan.layout, rest_ohm).read_ohm(frames).excess
    return float(np.median(plan.law.read_settled(excess).force_n))


def explain_noisy_rest(rest_force_n: float, *, plan: Plan) -> str | None:
    """Explain why the noise of a sheet at rest hides a contact; None if it does not.

    >>> from types import SimpleNamespace
    >>> plan = SimpleNamespace(no_push_n=1.0)
    >>> explain_noisy_rest(0.1, plan=plan)
    >>> explain_noisy_rest(1.06, plan=plan)[:62]
    'the noise of the sheet at rest reads as 1.06 N (at most 0.5 N,'
    """
    if rest_force_n <= 0.5 * plan.no_push_n:
        return None
    return (
        f"the noise of the sheet at rest reads as {rest_force_n:.2f} N (at most "
        f"{0.5 * plan.no_push_n:g} N, because {plan.no_push_n:g} N count as a contact); average "
        "more conversions, or use a converter of more bits or fewer pixels"
    )


def explain_implausible_rest(rest_ohm: FloatArray, *, plan: Plan) -> str | None:
    """Explain why rest values are implausible for this sheet; None if they are plausible.

    They are compared with the calibration's values: the median over pixels, then each pixel.

    >>> from types import SimpleNamespace
    >>> plan = SimpleNamespace(rest_ohm=np.array([[9e3, 8e3, 7e3]]))
    >>> explain_implausible_rest(np.array([[6e3, 5e3, 5e3]]), plan=plan)
    >>> explain_implausible_rest(np.array([[20.0, 20.0, 20.0]]), plan=plan)[:40]
    "the sheet's rest resistance is 0.0025 ti"
    """
    ratio = np.asarray(rest_ohm) / np.asarray(plan.rest_ohm)
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    if not ratio.size:
        return None
    common = float(np.median(ratio))
    if not 1.0 / GUARDS.sheet_factor < common < GUARDS.sheet_factor:
        return (
            f"the sheet's rest resistance is {common:.2g} times that of the calibration; climate "
            f"and wear change it by less than a factor of {GUARDS.sheet_factor:g}; run `palpate "
            "doctor`"
        )
    largest = float(np.exp(np.abs(np.log(ratio / common)).max()))
    if largest < GUARDS.pixel_factor:
        return None
    return (
        f"a pixel at rest has changed by a factor of {largest:.2g} relative to the others since "
        "the calibration, and climate or wear change all alike; run `palpate doctor`"
    )


def verify_rest(state: GraspState, rest_check_from: float, *, plan: Plan) -> bool:
    """Check during closing whether the steady frames before it were at rest.

    Return False if the readings since then are invalid, because the rest values have changed.
    """
    estimate = state.estimate
    if estimate.now.strongest_percent <= plan.hint_percent:
        reason = "the reading rose as soon as the fingers closed: the sheet was already loaded"
        _use_old_values(state, reason, plan=plan)
        estimate.steps, estimate.touches, estimate.contact_s = (), (), None
        state.attempt.rest_check_from = None
        return False
    if estimate.closure - rest_check_from >= plan.step:
        state.add_fault(
            "rest values are far below the calibration's, but the sheet is not loaded: climate or "
            "wear changed the sheet; `palpate calibrate rest --empty` stores the new values"
        )
        state.attempt.rest_check_from = None
    return True


def _use_old_values(state: GraspState, reason: str, *, plan: Plan) -> None:
    state.add_fault(f"the calibration's rest values are used: {reason}")
    state.estimate.rest_ohm, state.estimate.reader = plan.rest_ohm, None
