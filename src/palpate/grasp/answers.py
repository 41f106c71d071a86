"""Results of a grasp: settled reading, force, size and stiffness, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from palpate.estimate.soft_stiffness import measure_soft_stiffness
from palpate.grasp.config import APPROACH, READING, SETTLE
from palpate.grasp.estimator import ClosingStep, ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.measurement import Measurement, Status, half_width_sds
from palpate.sensor.sample import change_of_excess, excess_of_change
from palpate.settling.percent import percent_to_ratio, ratio_to_percent
from palpate.settling.result import SettledEstimate

#: Reasons for a stiffness with only a bound.
_SOFT_FINGERS = "the soft fingers deflect far more than the object"
_RIGID_FINGERS = (
    "the object deformed too little relative to the gripper's compliance; a firmer squeeze "
    "(--target-force-n) narrows the interval"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """Predicted reading of the sheet at the settling horizon."""

    relative_percent: Measurement
    reading: Measurement


def forecast(estimate: ContactEstimate, *, plan: Plan) -> Settled:
    """Predict the settled readings from the readings since the last movement.

    The predictor models the sheet, not the object. An object that relaxes (fruit loses a tenth to a
    third of its force) counteracts the sheet's creep. The interval is therefore widened by the
    difference between the forecast and the present reading. The creep measured in the sheet's
    calibration is combined with the forecast.
    """
    time_s = np.array([t.time_s for t in estimate.touches]) - estimate.moved_s
    relative_percent = np.array([t.relative_percent for t in estimate.touches])
    values = np.stack([percent_to_ratio(relative_percent), [t.reading for t in estimate.touches]])
    found = plan.settling.predict(time_s, values, horizon_s=plan.horizon_s, level=plan.level)
    seen = (estimate.now.relative_percent, estimate.now.reading)
    relative, reading = (
        _widen(one, by=float(one.value) - now, unit=unit)
        for one, now, unit in zip(
            (ratio_to_percent(found.hold(0)), found.hold(1)),
            seen,
            ("percent", "reading"),
            strict=True,
        )
    )
    reading = _replace_implausible(reading, now=estimate.now.reading)
    if plan.creep is not None:
        reading = plan.creep.combine(reading, now=estimate.now.reading, since_s=float(time_s[-1]))
        relative = _relative_forecast(reading, relative, now=estimate.now)
    return Settled(relative_percent=relative, reading=reading)


def _relative_forecast(reading: Measurement, relative: Measurement, *, now: Touch) -> Measurement:
    """Convert the forecast of the reading to a forecast of the relative change.

    The calibrated creep is that of the reading. Conductance is assumed to grow by the same factor
    in both. Pixels share a load unevenly, so the interval is widened by the difference between the
    forecast and the present change.
    """
    if not (now.reading > 0 and now.relative_percent < 0):
        return relative
    excess = float(excess_of_change(now.relative_percent))
    found = reading.mapped(
        lambda end: float(change_of_excess(excess * end / now.reading)), unit=relative.unit
    )
    found = replace(found, status=relative.status, reason=relative.reason)
    return found.widened(found.middle - now.relative_percent)


def _widen(one: SettledEstimate, *, by: float, unit: str) -> Measurement:
    value = float(one.value)
    # Without an interval from the predictor, only `by` remains.
    down, up = np.nan_to_num([value - one.low, one.high - value]).tolist()
    found = Measurement(
        value=value,
        low=value - down,
        high=value + up,
        unit=unit,
        level=one.level,
        status=Status(str(one.status)),
    )
    return found.widened(by)


def _replace_implausible(reading: Measurement, *, now: float) -> Measurement:
    """Return the forecast, or the current reading if the forecast is implausible."""
    least, most = now / SETTLE.max_change_ratio, now * SETTLE.max_change_ratio
    if now <= 0 or least <= reading.middle <= most:
        return reading
    return replace(reading, value=now, low=least, high=most, status=Status.FELL_BACK)


def measure_object(estimate: ContactEstimate, force: Measurement, *, plan: Plan) -> dict[str, Any]:
    """Return size, stiffness and firmness at the settled force, keyed by result field.

    Quantities that the gripper can't measure are omitted; firmness is available after every
    contact. Pressure-driven fingers measure no size, because their closure at contact is unknown
    in millimetres.
    """
    size_mm, stiffness = _measure(estimate, force, plan)
    if stiffness is None:
        size_mm, stiffness = _bound_from_travel(estimate, force, plan)
    found: dict[str, Any] = {}
    if size_mm is not None and plan.bend is None:
        found["size_mm"] = size_mm
    if stiffness is not None:
        found["firmness"] = firmness_index(stiffness)
        # A wide interval becomes a bound.
        reason = _RIGID_FINGERS if plan.bend is None else _SOFT_FINGERS
        bounded = stiffness.or_bound(reason, least=SOFTEST_N_PER_MM, most=STIFFEST_N_PER_MM)
        found["stiffness_n_per_mm"] = bounded
    return found


def _bound_from_travel(
    estimate: ContactEstimate, force: Measurement, plan: Plan
) -> tuple[Measurement | None, Measurement | None]:
    """Bound size and stiffness from the travel since contact and the force.

    Used for contacts that are too light for a curve. Contact began between the last step
    without force and the first step at which both fingers certainly pressed. The deformation is at
    most the closing since the former, and at least the closing since the latter minus the gripper's
    deflection.
    """
    compliance = plan.gripper_compliance
    if compliance is None or not estimate.steps:
        return None, None
    without_contact = [
        step.closure
        for step in estimate.steps
        if step.touch.strongest_percent > READING.contact_percent
    ]
    pressed = [
        step.closure for step in estimate.steps if step.touch.weakest_percent <= plan.hint_percent
    ]
    begin = estimate.steps[0].closure - APPROACH.overrun_steps * plan.step
    begin = without_contact[-1] if without_contact else begin
    longest_mm = mm_per_unit(plan) * (estimate.closure - begin)
    least_mm = mm_per_unit(plan) * (estimate.closure - pressed[0]) if pressed else 0.0
    held_mm = mm_per_unit(plan) * _opening(plan, estimate.closure) - compliance.zero_mm
    size_mm = Measurement(
        value=held_mm + 0.5 * (longest_mm + least_mm),
        low=held_mm + least_mm,
        high=held_mm + longest_mm,
        unit="mm",
        level=force.level,
    )
    shortest_mm = least_mm - float(compliance.deflection_mm(force.high))
    # The first reading may include a force as large as the scatter of weak readings.
    initial_n = CONTACT_SD * floor_n(plan)
    own_mm = longest_mm - float(compliance.deflection_mm(force.middle))
    low, high, value = (
        min(max(force_n / max(travel_mm, 1e-3), SOFTEST_N_PER_MM), STIFFEST_N_PER_MM)
        for force_n, travel_mm in (
            (force.low - initial_n, longest_mm),
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
    settled: Settled, *, measured: MeasuredForce | None, plan: Plan
) -> Measurement:
    """Convert the settled reading to newtons, and combine it with the gripper's measurement.

    The uncertainty of ln force has three parts: the scatter of the law, drift since calibration,
    and the forecast's interval propagated through the law.
    """
    reading = settled.reading
    law = Gain.from_calibration(
        law_sd=plan.settled_law.residual_sd, additional_sd=SETTLE.drift_sd
    ).apply_to(
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
    sheet = Measurement(
        value=value,
        low=value * math.exp(-down),
        high=value * math.exp(up),
        unit="n",
        level=plan.level,
        status=status,
    )
    if measured is None:
        return sheet
    relaxed = replace(measured, log_sd=math.hypot(measured.log_sd, SETTLE.drift_sd))
    # Unlike `log_sd`, without a limit for a force whose lower limit is 0.
    law_sd = 0.5 * (down + up) / half_width_sds(plan.level)
    gain = Gain.from_calibration(law_sd=law_sd).update(relaxed, sheet_n=value)
    return Measurement.from_log_sd(
        value * math.exp(gain.log_mean),
        log_sd=gain.log_sd,
        unit="n",
        level=plan.level,
        status=status,
    )


def _log_ratio(large: float, small: float) -> float:
    # A bound of 0 N counts as a thousandth of the force, to keep its logarithm finite.
    return float(np.log(large / max(small, 1e-3 * large)))


def measure_stiffness(
    estimate: ContactEstimate, force: Measurement, *, plan: Plan
) -> Measurement | None:
    """Return the object's secant stiffness at a force; None if the gripper can't measure it."""
    return _measure(estimate, force, plan)[1]


def _measure(
    estimate: ContactEstimate, force: Measurement, plan: Plan
) -> tuple[Measurement | None, Measurement | None]:
    """Estimate size and stiffness from the closing curve; None if the force is too low."""
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
    """Return the number of closing steps from which stiffness can be estimated."""
    found = _closing_curve(estimate, plan)
    return 0 if found is None else int(np.count_nonzero(found[0].is_certain))


def _closing_curve(estimate: ContactEstimate, plan: Plan) -> tuple[ClosingSteps, Compliance] | None:
    """Return the closing curve from just before contact, and the gripper's compliance.

    Forces are from the early law. For pressure-driven fingers, closing is computed from their
    travel per pressure. None without a known compliance or a contact.
    """
    compliance = plan.gripper_compliance
    steps = _steps_from_touch(estimate, plan)
    if compliance is None or not steps:
        return None
    width, contact, read = _read_steps(steps, estimate, plan)
    firmest = int(np.argmax(read.value))
    curve = ClosingSteps(
        width_mm=mm_per_unit(plan) * width - compliance.zero_mm,
        force_n=np.where(contact, read.value, 0.0),
        gain_sd=read.upper_log_sd(firmest),
        law_sd=estimate.gain.law_sd,
        floor_n=floor_n(plan),
    )
    return curve, compliance


def _read_steps(
    steps: Sequence[ClosingStep], estimate: ContactEstimate, plan: Plan
) -> tuple[FloatArray, NDArray[np.bool_], ForceEstimate]:
    """Return each step's opening (mm or -kPa), its contact flag, and its early force."""
    reading = [step.touch.reading for step in steps]
    weakest_percent = np.array([step.touch.weakest_percent for step in steps])
    read = estimate.gain.apply_to(plan.early_law.force_n(reading, level=plan.level))
    return (
        np.array([_opening(plan, step.closure) for step in steps]),
        # Rising pixels may cancel the fall of others.
        (weakest_percent < READING.contact_percent) & (read.value > 0.0),
        read,
    )


def _opening(plan: Plan, closure: float) -> float:
    """Return the opening at a closure: the width, mm, or the negative pressure, kPa."""
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
    """Return the steps, starting two before the first hint of contact; empty without a hint.

    More steps before the hint are excluded, because drift can resemble a weak contact.
    """
    hinted = [c.touch.weakest_percent < plan.hint_percent for c in estimate.steps]
    if not any(hinted):
        return ()
    return estimate.steps[max(hinted.index(True) - 2, 0) :]


def floor_n(plan: Plan) -> float:
    """Return the scatter of forces below the sheet's threshold, N."""
    return float(plan.early_law.force_n(0.0, level=plan.level).upper_sd_n)
