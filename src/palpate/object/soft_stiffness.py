"""Stiffness of an object from a grasp with fingers softer than the object.

Soft fingers deflect by millimetres per newton. The object's deformation is therefore a small
difference between two large distances: the free travel of the fingers since contact, and their
deflection under the force. The curve in between adds little information, because an error of the
sheet's exponent bends it like an object would. Only its first and last point are used, and the
result is often only a lower bound of the stiffness.

The two points give the compliance (mm/N) of hand and object together, with the relative uncertainty
of the force. The hand's compliance is known. The remainder is that of the object, which can't be
negative, so its interval is that of a bounded quantity (`palpate.object.feldman_cousins`).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from palpate.measurement import Measurement, Status
from palpate.object.closing_curve import ClosingSteps, normal_density
from palpate.object.compliance import SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, Compliance
from palpate.object.feldman_cousins import interval_above_zero, median_above_zero

#: Error (ln force) of the first measured force relative to the last of the same contact. The first
#: force is nearest to the threshold, and acts on other pixels. On 160 development closings of the
#: twin: 0.15 to 0.19 at both levels.
_FIRST_SD = 0.2
#: Degrees of freedom of the scatter between contacts: seven placements of the guided calibration,
#: minus one for the scale.
_FREEDOM = 6
_FORCES = 200


def measure_soft_stiffness(
    curve: ClosingSteps, *, compliance: Compliance, opening_mm: float, force: Measurement
) -> Measurement | None:
    """Estimate the object's secant stiffness at the settled force; None with too little force.

    `curve`: the closing, with the free widths, which the fingers would have without an object.
    `opening_mm`: final free width.
    `force`: settled force at that width, newtons.
    The status is `saturated` if the object may be rigid. The interval's coverage holds for every
    true stiffness; one rigid object in ten therefore gets a finite upper limit.

    Fingers of 3.5 mm/N with contact at 40 mm, on 0.5 N/mm and on a rigid object:

    >>> compliance = Compliance(slope_mm_per_n=3.5, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.1,
    ...     largest_force_n=15.0)
    >>> held = Measurement(value=4.0, low=3.6, high=4.4, unit="n", level=0.9)
    >>> force_n = np.array([0.0, 0.5, 2.0, 4.0])
    >>> for own_mm_per_n in (2.0, 0.0):
    ...     width_mm = 40.0 - (3.5 + own_mm_per_n) * force_n
    ...     curve = ClosingSteps(width_mm=width_mm, force_n=force_n, gain_sd=0.05,
    ...         law_sd=0.1, floor_n=0.02, weak_n=0.04)
    ...     found = measure_soft_stiffness(curve, compliance=compliance, opening_mm=width_mm[-1],
    ...         force=held)
    ...     print(found.low < 0.5 < found.high, found.status)
    True ok
    False saturated
    """
    if not curve.is_certain.any() or force.middle <= 0:
        return None
    together = _measure_compliance(curve, compliance, opening_mm, force.middle)
    if together is None:
        return None
    log_mm_per_n, travel_sd = together
    sd = math.hypot(force.log_sd, travel_sd)
    hand_mm_per_n = float(compliance.deflection_mm(force.middle)) / force.middle
    excess = (log_mm_per_n - math.log(hand_mm_per_n)) / sd
    least, most = interval_above_zero(excess, freedom=_FREEDOM, level=force.level)
    middle = median_above_zero(excess, freedom=_FREEDOM)
    low, value, high = (
        _stiffness_n_per_mm(hand_mm_per_n * math.expm1(min(sd * end, 700.0)))
        for end in (most, middle, least)
    )
    return Measurement(
        value=value,
        low=low,
        high=high,
        unit="n_per_mm",
        level=force.level,
        status=Status.SATURATED if least == 0.0 else force.status,
    )


def _stiffness_n_per_mm(softness_mm_per_n: float) -> float:
    least, most = 1.0 / STIFFEST_N_PER_MM, 1.0 / SOFTEST_N_PER_MM
    return 1.0 / min(max(softness_mm_per_n, least), most)


def _measure_compliance(
    curve: ClosingSteps, compliance: Compliance, opening_mm: float, force_n: float
) -> tuple[float, float] | None:
    """Return ln compliance (mm/N) of gripper and object, and its scatter.

    The compliance is the travel since the first contact over the rise of force. Both forces have
    the same gain, so the scatter excludes the uncertainty of the gain.
    """
    first = int(np.argmax(curve.is_certain))
    touched_mm, first_n = float(curve.width_mm[first]), float(curve.force_n[first])
    travel_mm = touched_mm - opening_mm
    if not travel_mm > 0:
        return None
    then_n = np.linspace(0.0, 0.95, _FORCES) * force_n
    softness = travel_mm / (force_n - then_n)
    likely = normal_density(then_n, first_n, math.hypot(_FIRST_SD * first_n, curve.floor_n))
    if first > 0:
        # At the step before the first reading, the force was at most weak.
        step_mm = float(curve.width_mm[first - 1]) - touched_mm
        most_n = curve.weak_n + step_mm / softness
        sd_n = np.hypot(curve.floor_n, compliance.residual_mm / softness)
        likely = likely * ndtr((most_n - then_n) / sd_n)
    if not likely.sum() > 0:
        return None
    mean = float(np.average(np.log(softness), weights=likely))
    spread = float(np.average((np.log(softness) - mean) ** 2, weights=likely))
    return mean, math.hypot(math.sqrt(spread), compliance.residual_mm / travel_mm)
