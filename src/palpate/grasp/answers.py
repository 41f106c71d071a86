"""The answers of a grasp: settled value, force, size and stiffness, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.estimate.closing_curve import CONTACT_SD, ClosingSteps, measure_closing
from palpate.estimate.compliance import (
    SOFTEST_N_PER_MM,
    STIFFEST_N_PER_MM,
    Compliance,
)
from palpate.estimate.firmness import firmness_index
from palpate.estimate.force import ForceEstimate
from palpate.estimate.gain import Gain, MeasuredForce
from palpate.estimate.measurement import Measurement
from palpate.estimate.soft_stiffness import measure_soft_stiffness
from palpate.grasp.config import APPROACH, READING, SETTLE
from palpate.grasp.estimator import ClosingStep, ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.settling.percent import as_percent, of_rest
from palpate.settling.result import SettledEstimate, Status

#: Why a stiffness is only bounded.
_SOFT_FINGERS = "the soft fingers deflect far more than the object"
_RIGID_FINGERS = (
    "the object gave way too little compared with the hand's own give; a firmer squeeze "
    "(--target-force-n) would show more"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """The sheet's predicted reading at the horizon."""

    relative_percent: Measurement
    reading: Measurement


def forecast(estimate: ContactEstimate, *, plan: Plan) -> Settled:
    """Predict the settled readings from the touches since the last movement.

    The predictor models sheets, not objects; one that relaxes in the hand (fruit loses a tenth to a
    third of its force) works against the sheet's creep. So the interval is widened by as far as the
    forecast goes beyond what was seen. What the sheet's own calibration showed of its creep is
    weighed in.
    """
    time_s = np.array([t.time_s for t in estimate.touches]) - estimate.moved_s
    relative_percent = np.array([t.relative_percent for t in estimate.touches])
    values = np.stack([of_rest(relative_percent), [t.reading for t in estimate.touches]])
    found = plan.settling.predict(time_s, values, horizon_s=plan.horizon_s, level=plan.level)
    seen = (estimate.now.relative_percent, estimate.now.reading)
    relative, reading = (
        _widen(one, by=float(one.value) - now, unit=unit)
        for one, now, unit in zip(
            (as_percent(found.hold(0)), found.hold(1)), seen, ("percent", "reading"), strict=True
        )
    )
    reading = _keep_plausible(reading, now=estimate.now.reading)
    if plan.creep is not None:
        reading = plan.creep.join(reading, now=estimate.now.reading, since_s=float(time_s[-1]))
        relative = _relative_forecast(reading, relative, now=estimate.now)
    return Settled(relative_percent=relative, reading=reading)


def _relative_forecast(reading: Measurement, relative: Measurement, *, now: Touch) -> Measurement:
    """Return the forecast of the relative change that the forecast of the reading makes.

    The sheet's own creep is known for the reading; conductance grows by the same share in both. Not
    exactly, as pixels share a load unevenly: the interval is as wide as the forecast goes beyond
    what was seen, at least.
    """
    if not (now.reading > 0 and now.relative_percent < 0):
        return relative
    excess = 1.0 / (1.0 + now.relative_percent / 100.0) - 1.0
    value, low, high = (
        100.0 * (1.0 / (1.0 + excess * end / now.reading) - 1.0)
        for end in (reading.middle, reading.high, reading.low)
    )
    by = value - now.relative_percent
    return replace(
        relative,
        value=value,
        low=value - float(np.hypot(value - low, by)),
        high=value + float(np.hypot(high - value, by)),
    )


def _widen(one: SettledEstimate, *, by: float, unit: str) -> Measurement:
    value = float(one.value)
    # A predictor without an interval of its own leaves only what it added to what was seen.
    down, up = np.nan_to_num([value - one.low, one.high - value])
    return Measurement(
        value=value,
        low=value - float(np.hypot(down, by)),
        high=value + float(np.hypot(up, by)),
        unit=unit,
        level=one.level,
        status=Status(str(one.status)),
    )


def _keep_plausible(reading: Measurement, *, now: float) -> Measurement:
    """Return the forecast, or the present reading if the forecast is implausible."""
    least, most = now / SETTLE.max_change_ratio, now * SETTLE.max_change_ratio
    if now <= 0 or least <= reading.middle <= most:
        return reading
    return replace(reading, value=now, low=least, high=most, status=Status.FELL_BACK)


def is_certain(settled: Settled, *, plan: Plan) -> bool:
    """Whether the interval of the settled reading is narrow enough to act on.

    Waiting helps only while the forecast's uncertainty exceeds half of the force law's.
    """
    reading = settled.reading
    half = max(reading.high - reading.middle, reading.middle - reading.low)
    of_law = 0.5 * float(ndtri(0.5 + plan.level / 2)) * plan.settled_law.residual_sd
    enough = max(plan.decide_half_width, of_law)
    # The interval is widened by all that the forecast adds, so an unproven shape does no harm.
    known = reading.status in (Status.OK, Status.UNPROVEN)
    return known and half <= enough * abs(reading.middle)


def measure_object(estimate: ContactEstimate, force: Measurement, *, plan: Plan) -> dict[str, Any]:
    """Return size, stiffness and firmness at the settled force, by field of the result.

    What the hand can't measure is left out; what was touched has a firmness. Fingers driven by
    pressure give no size: how far they have closed at the touch is not known in millimetres.
    """
    size_mm, stiffness = _measure(estimate, force, plan)
    if stiffness is None:
        size_mm, stiffness = _bound_by_travel(estimate, force, plan)
    found: dict[str, Any] = {}
    if size_mm is not None and plan.bend is None:
        found["size_mm"] = size_mm
    if stiffness is not None:
        found["firmness"] = firmness_index(stiffness)
        # A bound where it may be anything.
        reason = _RIGID_FINGERS if plan.bend is None else _SOFT_FINGERS
        bounded = stiffness.or_bound(reason, least=SOFTEST_N_PER_MM, most=STIFFEST_N_PER_MM)
        found["stiffness_n_per_mm"] = bounded
    return found


def _bound_by_travel(
    estimate: ContactEstimate, force: Measurement, plan: Plan
) -> tuple[Measurement | None, Measurement | None]:
    """Return the size and stiffness possible with the travel since contact and the force.

    For a touch so faint that too few steps show a curve. The object was touched between the last
    step without force and the first at which both fingers certainly pressed. It deflected by no
    more than the hand closed since the one, and by no less than since the other, less what the hand
    itself gives.
    """
    compliance = plan.gripper_compliance
    if compliance is None or not estimate.steps:
        return None, None
    unfelt = [
        step.closure
        for step in estimate.steps
        if step.touch.strongest_percent > READING.contact_percent
    ]
    pressed = [
        step.closure for step in estimate.steps if step.touch.weaker_percent <= plan.hint_percent
    ]
    begin = unfelt[-1] if unfelt else estimate.steps[0].closure - APPROACH.overrun_steps * plan.step
    longest_mm = mm_per_unit(plan) * (estimate.closure - begin)
    surely_mm = mm_per_unit(plan) * (estimate.closure - pressed[0]) if pressed else 0.0
    held_mm = mm_per_unit(plan) * _opening(plan, estimate.closure) - compliance.zero_mm
    size_mm = Measurement(
        value=held_mm + 0.5 * (longest_mm + surely_mm),
        low=held_mm + surely_mm,
        high=held_mm + longest_mm,
        unit="mm",
        level=force.level,
    )
    shortest_mm = surely_mm - float(compliance.deflection_mm(force.high))
    # The first reading may include as much force as the scatter of faint readings.
    begun_n = CONTACT_SD * floor_n(plan)
    own_mm = longest_mm - float(compliance.deflection_mm(force.middle))
    low, high, value = (
        min(max(force_n / max(way_mm, 1e-3), SOFTEST_N_PER_MM), STIFFEST_N_PER_MM)
        for force_n, way_mm in (
            (force.low - begun_n, longest_mm),
            (force.high, shortest_mm),
            (force.middle, own_mm),
        )
    )
    if own_mm <= 0:
        value = math.sqrt(low * high)
    return size_mm, Measurement(
        value=min(max(value, low), high), low=low, high=high, unit="n_per_mm", level=force.level
    )


def measure_settled_force(
    settled: Settled, *, felt: MeasuredForce | None, plan: Plan
) -> Measurement:
    """Convert the settled reading to newtons, combined with the gripper's own measurement.

    Uncertainties add in ln force: the law's own scatter, use of the sheet since, and the forecast's
    interval, carried through the law.
    """
    reading = settled.reading
    more_sd = float(np.hypot(SETTLE.drift_sd, SETTLE.relaxation_sd))
    law = Gain.from_calibration(law_sd=plan.settled_law.residual_sd, more_sd=more_sd).apply_to(
        plan.settled_law.force_n([reading.middle, reading.low, reading.high], level=plan.level)
    )
    value = float(law.value[0])
    status = Status.OK if bool(law.in_range[0]) else Status.SATURATED
    status = reading.status if status is Status.OK else status
    if value <= 0:
        low, high = 0.0, float(law.high[0])
        return Measurement(value=0.0, low=low, high=high, unit="n", level=plan.level, status=status)
    down = float(np.hypot(_log_ratio(value, law.low[0]), _log_ratio(value, law.value[1])))
    up = float(np.hypot(_log_ratio(law.high[0], value), _log_ratio(law.value[2], value)))
    if felt is not None:
        reach = float(ndtri(0.5 + plan.level / 2))
        relaxed = replace(
            felt,
            force_n=SETTLE.relaxation_ratio * felt.force_n,
            log_sd=float(np.hypot(felt.log_sd, SETTLE.relaxation_sd)),
        )
        gain = Gain.from_calibration(law_sd=0.5 * (down + up) / reach).update(
            relaxed, sheet_n=value
        )
        value, down, up = value * float(np.exp(gain.log_mean)), *(reach * gain.log_sd,) * 2
    return Measurement(
        value=value,
        low=value * float(np.exp(-down)),
        high=value * float(np.exp(up)),
        unit="n",
        level=plan.level,
        status=status,
    )


def _log_ratio(large: float, small: float) -> float:
    # A bound at 0 N counts as a thousandth: its logarithm would dominate everything else.
    return float(np.log(large / max(small, 1e-3 * large)))


def measure_stiffness(
    estimate: ContactEstimate, force: Measurement, *, plan: Plan
) -> Measurement | None:
    """Return the object's secant stiffness at a force, if the gripper can measure it."""
    return _measure(estimate, force, plan)[1]


def _measure(
    estimate: ContactEstimate, force: Measurement, plan: Plan
) -> tuple[Measurement | None, Measurement | None]:
    """Return size and stiffness from the closing curve; None if the force is too low."""
    found = _closing_curve(estimate, plan)
    if found is None:
        return None, None
    curve, compliance = found
    opening_mm = mm_per_unit(plan) * _opening(plan, estimate.closure) - compliance.zero_mm
    if plan.bend is None:
        answer = measure_closing(curve, compliance=compliance, opening_mm=opening_mm, force=force)
        return answer or (None, None)
    return None, measure_soft_stiffness(
        curve, compliance=compliance, opening_mm=opening_mm, force=force
    )


def count_contact_steps(estimate: ContactEstimate, plan: Plan) -> int:
    """Return how many steps of the closing a stiffness can be estimated from."""
    found = _closing_curve(estimate, plan)
    return 0 if found is None else int(np.count_nonzero(found[0].is_certain))


def _closing_curve(estimate: ContactEstimate, plan: Plan) -> tuple[ClosingSteps, Compliance] | None:
    """Return the steps read in early forces, from just before the first touch on.

    Fingers driven by pressure close by their compliance per pressure; with them the compliance that
    is taken out. None where neither is known, or nothing was touched.
    """
    compliance = plan.gripper_compliance
    steps = _steps_from_touch(estimate, plan)
    if compliance is None or not steps:
        return None
    width, felt, read = _read_steps(steps, estimate, plan)
    firmest = int(np.argmax(read.value))
    reach = float(ndtri(0.5 + plan.level / 2))
    curve = ClosingSteps(
        width_mm=mm_per_unit(plan) * width - compliance.zero_mm,
        force_n=np.where(felt, read.value, 0.0),
        gain_sd=float(np.log(read.high[firmest] / read.value[firmest])) / reach,
        law_sd=estimate.gain.law_sd,
        floor_n=floor_n(plan),
    )
    return curve, compliance


def _read_steps(
    steps: Sequence[ClosingStep], estimate: ContactEstimate, plan: Plan
) -> tuple[FloatArray, NDArray[np.bool_], ForceEstimate]:
    """Return each step's opening (mm or -kPa), whether a contact was detected, and early force."""
    reading = [step.touch.reading for step in steps]
    weaker_percent = np.array([step.touch.weaker_percent for step in steps])
    read = estimate.gain.apply_to(plan.early_law.force_n(reading, level=plan.level))
    return (
        np.array([_opening(plan, step.closure) for step in steps]),
        # Pixels that rise may cancel the fall of others.
        (weaker_percent < READING.contact_percent) & (read.value > 0.0),
        read,
    )


def _opening(plan: Plan, closure: float) -> float:
    """Return the opening at a closure: the width, mm, or the pressure taken negative, kPa."""
    target = plan.gripper.target(closure)
    return target if plan.bend is None else -target


def mm_per_unit(plan: Plan) -> float:
    """Return the closing travel per unit of the drive, mm per mm or kPa."""
    return 1.0 if plan.bend is None else plan.bend.mm_per_kpa


def sheet_forces_n(
    steps: Sequence[ClosingStep], estimate: ContactEstimate, plan: Plan
) -> FloatArray:
    """Return the early force of each step from the sheet and contact gain."""
    law = plan.early_law.force_n(np.array([step.touch.reading for step in steps]))
    return np.asarray(math.exp(estimate.gain.log_mean) * law.value)


def _steps_from_touch(estimate: ContactEstimate, plan: Plan) -> tuple[ClosingStep, ...]:
    """Return the steps from the one before the first certain touch; none without one.

    Drift can resemble a faint contact long before the real one: no more than two steps of it.
    """
    hinted = [c.touch.weaker_percent < plan.hint_percent for c in estimate.steps]
    if not any(hinted):
        return ()
    return estimate.steps[max(hinted.index(True) - 2, 0) :]


def floor_n(plan: Plan) -> float:
    """Return the scatter of faint forces, below the sheet's threshold."""
    nothing = plan.early_law.force_n(0.0, level=plan.level)
    return float(nothing.high) / float(ndtri(0.5 + plan.level / 2))
