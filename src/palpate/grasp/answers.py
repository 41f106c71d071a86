"""Results of a grasp: settled reading, force, size and stiffness, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.force.gain import Gain, MeasuredForce
from palpate.grasp.config import READING, SETTLE
from palpate.grasp.estimator import ClosingStep, ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.measurement import Measurement, Status, half_width_sds
from palpate.object.closing_curve import (
    CONTACT_SD,
    ClosingAnswer,
    ClosingSteps,
    measure_closing,
)
from palpate.object.compliance import (
    SOFTEST_N_PER_MM,
    STIFFEST_N_PER_MM,
    Compliance,
)
from palpate.object.firmness import firmness_index
from palpate.object.soft_stiffness import measure_soft_stiffness
from palpate.sensor.sample import change_of_excess
from palpate.signal.relative import mean_change

#: Reasons for a stiffness with only a bound.
_SOFT_FINGERS = "the soft fingers deflect far more than the object"
_RIGID_FINGERS = (
    "the object deformed too little relative to the gripper's compliance; a firmer squeeze "
    "(--target-force-n) narrows the interval"
)


def forecast(estimate: ContactEstimate, *, plan: Plan) -> Measurement:
    """Predict the mean relative change at the settling horizon, percent.

    The law of the sheet tells the reading at which the creep of each pixel ends under the present
    force. An object that relaxes (fruit loses a tenth to a third of its force) counteracts that
    creep. The interval therefore includes the difference between the forecast and the present
    change, and a changed force.
    """
    reader, now = estimate.reader, estimate.now
    assert reader is not None

    def change_at(log_n: float) -> float:
        return float(mean_change(change_of_excess(reader.settle(log_n=log_n))))

    middle, log_n = change_at(0.0), half_width_sds(plan.level) * SETTLE.drift_sd
    creep = middle - float(mean_change(change_of_excess(reader.excess)))
    value = now.relative_percent + creep
    return Measurement(
        value=value,
        low=value - math.hypot(creep, middle - change_at(log_n)),
        high=value + math.hypot(creep, change_at(-log_n) - middle),
        unit="percent",
        level=plan.level,
    )


def measure_object(estimate: ContactEstimate, force: Measurement, *, plan: Plan) -> dict[str, Any]:
    """Return size, stiffness and firmness at a present force, keyed by result field.

    The stiffness is that of the object at its settled force. Firmness is that at
    `Plan.firmness_force_n`, because a round object is stiffer at a larger force; soft fingers do
    not tell the difference.
    Quantities that the gripper can't measure are omitted; firmness is available after every
    contact. Pressure-driven fingers measure no size, because their closure at contact is unknown
    in millimetres.
    """
    answer = _measure(estimate, force, plan)
    if answer is None:
        return {}
    # A wide interval becomes a bound.
    reason = _RIGID_FINGERS if plan.bend is None else _SOFT_FINGERS
    bounded = answer.stiffness.or_bound(reason, least=SOFTEST_N_PER_MM, most=STIFFEST_N_PER_MM)
    found = {
        "firmness": firmness_index(answer.reference),
        "firmness_force_n": force.middle if answer.size_mm is None else plan.firmness_force_n,
        "stiffness_n_per_mm": bounded,
    }
    return found if answer.size_mm is None else found | {"size_mm": answer.size_mm}


def gain_of_law(touch: Touch, plan: Plan) -> Gain:
    """Return the gain of a contact that only the sheet's law tells, at the force of a reading."""
    weak_sd = plan.law.floor_n / max(touch.sheet_n, plan.law.floor_n)
    return Gain.of_law(math.hypot(touch.log_sd, weak_sd))


def read_force(touch: Touch, gain: Gain, plan: Plan) -> Measurement:
    """Return the grip force of a reading, newtons, with the gain of this contact."""
    value, level = gain.factor * touch.sheet_n, plan.level
    if gain.is_measured:
        return Measurement.from_log_sd(value, log_sd=gain.log_sd, unit="n", level=level)
    low, high = plan.law.interval_n(value, log_sd=touch.log_sd, level=level)
    return Measurement(value=value, low=float(low), high=float(high), unit="n", level=level)


def measure_force(now: Touch, *, measured: MeasuredForce | None, plan: Plan) -> Measurement:
    """Combine the sheet's present force with the gripper's own measurement.

    The law of the sheet takes its creep out of the reading.
    """
    gain = gain_of_law(now, plan)
    if measured is not None:
        gain = gain.update(measured, sheet_n=now.sheet_n)
    force = read_force(now, gain, plan)
    return replace(force, status=Status.SATURATED) if now.is_beyond else force


def measure_stiffness(
    estimate: ContactEstimate, force: Measurement, *, plan: Plan
) -> Measurement | None:
    """Return the secant stiffness of the object that has relaxed from a present force.

    None if the gripper can't measure it.
    """
    answer = _measure(estimate, force, plan)
    return None if answer is None else answer.stiffness


def measure_closing_stiffness(
    estimate: ContactEstimate, force: Measurement, *, plan: Plan
) -> Measurement | None:
    """Return the stiffness of the closing at a present force, as a damage model is trained on it.

    None if the gripper can't measure it.
    """
    answer = _measure(estimate, force, plan)
    return None if answer is None else answer.closing


def _measure(estimate: ContactEstimate, force: Measurement, plan: Plan) -> ClosingAnswer | None:
    """Estimate size and stiffness from the closing curve; None if the force is too low."""
    found = _closing_curve(estimate, plan)
    if found is None:
        return None
    curve, compliance = found
    opening_mm = mm_per_unit(plan) * _opening(plan, estimate.closure) - compliance.zero_mm
    if plan.bend is None:
        return measure_closing(
            curve,
            compliance=compliance,
            opening_mm=opening_mm,
            force=force,
            reference_n=plan.firmness_force_n,
        )
    stiffness = measure_soft_stiffness(
        curve, compliance=compliance, opening_mm=opening_mm, force=force
    )
    return None if stiffness is None else ClosingAnswer(None, stiffness, stiffness, stiffness)


def count_contact_steps(estimate: ContactEstimate, plan: Plan) -> int:
    """Return the number of closing steps from which stiffness can be estimated."""
    found = _closing_curve(estimate, plan)
    return 0 if found is None else int(np.count_nonzero(found[0].is_certain))


def _closing_curve(estimate: ContactEstimate, plan: Plan) -> tuple[ClosingSteps, Compliance] | None:
    """Return the closing curve from just before contact, and the gripper's compliance.

    For pressure-driven fingers, closing is computed from their
    travel per pressure. None without a known compliance or a contact.
    """
    compliance = plan.gripper_compliance
    steps = _steps_from_touch(estimate, plan)
    if compliance is None or not steps:
        return None
    width = np.array([_opening(plan, step.closure) for step in steps])
    force_n = sheet_forces_n(steps, estimate)
    # Rising pixels may cancel the fall of others.
    contact = np.array([step.touch.weakest_percent < READING.contact_percent for step in steps])
    curve = ClosingSteps(
        width_mm=mm_per_unit(plan) * width - compliance.zero_mm,
        force_n=np.where(contact, force_n, 0.0),
        gain_sd=estimate.gain.log_sd,
        law_sd=estimate.gain.law_sd,
        floor_n=plan.law.floor_n,
        weak_n=CONTACT_SD * plan.law.weak_sd_n,
    )
    return curve, compliance


def _opening(plan: Plan, closure: float) -> float:
    """Return the opening at a closure: the width, mm, or the negative pressure, kPa."""
    target = plan.gripper.target(closure)
    return target if plan.bend is None else -target


def mm_per_unit(plan: Plan) -> float:
    """Return the closing travel per unit of the drive, mm per mm or kPa."""
    return 1.0 if plan.bend is None else plan.bend.mm_per_kpa


def sheet_forces_n(steps: Sequence[ClosingStep], estimate: ContactEstimate) -> FloatArray:
    """Return the force of each step from the sheet and the gain of the contact."""
    return estimate.gain.factor * np.array([step.touch.sheet_n for step in steps])


def _steps_from_touch(estimate: ContactEstimate, plan: Plan) -> tuple[ClosingStep, ...]:
    """Return the steps, starting two before the first hint of contact, or before the last step.

    More steps before the hint are excluded, because drift can resemble a weak contact.
    """
    hinted = [step.touch.weakest_percent < plan.hint_percent for step in estimate.steps[:-1]]
    return estimate.steps[max([*hinted, True].index(True) - 2, 0) :]
