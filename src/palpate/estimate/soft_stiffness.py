"""An object's stiffness from a grasp by fingers softer than the object.

Soft fingers deflect by millimetres per newton, so the object's deformation is a small difference
of two large distances: how far the fingers would have closed beyond the first touch, and how far
they bent back under the force. The curve in between adds little, because an error of the sheet's
exponent bends it as an object would. So only both ends are used, and the answer states what they
leave open: often no more than a lower bound of the stiffness.

Both ends give the softness (mm/N) of hand and object together, with the relative uncertainty of the
force. The hand's own softness is known; the rest is the object's, and can't be negative. That makes
it the measurement of a bounded quantity (`palpate.estimate.feldman_cousins`).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr, ndtri

from palpate.estimate.closing_curve import ClosingSteps, normal_density
from palpate.estimate.compliance import SOFTEST_N_PER_MM, STIFFEST_N_PER_MM, Compliance
from palpate.estimate.feldman_cousins import interval_above_zero, median_above_zero
from palpate.estimate.measurement import Measurement
from palpate.settling.result import Status

#: Relative to the last force of the same contact, the first measured force has this error
#: (ln force): it is the nearest to the threshold, and spread over other pixels. On 160
#: development closings of the twin 0.15 to 0.19 at both levels.
_FIRST_SD = 0.2
#: The scatter of the force from contact to contact is measured by the placements of the guided
#: calibration, seven of them, less one for the scale.
_FREEDOM = 6
_FORCES = 200


def measure_soft_stiffness(
    curve: ClosingSteps, *, compliance: Compliance, opening_mm: float, force: Measurement
) -> Measurement | None:
    """Return the object's secant stiffness at the settled force; None with too little force.

    `curve`: the closing; widths are those that the fingers would have with nothing between them.
    `opening_mm`: final width of that kind.
    `force`: settled force there, newtons.
    Its status is `saturated` where the object may be as stiff as you like. The interval covers as
    often as its level states whatever the true stiffness, so one in ten rigid objects gets an upper
    end.

    Fingers of 3.5 mm/N with contact at 40 mm, on 0.5 N/mm and on a rigid object:

    >>> compliance = Compliance(slope_mm_per_n=3.5, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.1,
    ...     largest_force_n=15.0)
    >>> held = Measurement(value=4.0, low=3.6, high=4.4, unit="n", level=0.9)
    >>> force_n = np.array([0.0, 0.5, 2.0, 4.0])
    >>> for own_mm_per_n in (2.0, 0.0):
    ...     width_mm = 40.0 - (3.5 + own_mm_per_n) * force_n
    ...     curve = ClosingSteps(width_mm=width_mm, force_n=force_n, gain_sd=0.05,
    ...         law_sd=0.1, floor_n=0.02)
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
    log_mm_per_n, ways_sd = together
    reach = float(ndtri(0.5 + force.level / 2))
    force_sd = math.log(force.high / max(force.low, 1e-3 * force.middle)) / (2 * reach)
    sd = math.hypot(force_sd, ways_sd)
    hand_mm_per_n = float(compliance.deflection_mm(force.middle)) / force.middle
    beyond = (log_mm_per_n - math.log(hand_mm_per_n)) / sd
    least, most = interval_above_zero(beyond, freedom=_FREEDOM, level=force.level)
    middle = median_above_zero(beyond, freedom=_FREEDOM)
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
    """Return ln compliance (mm/N) of gripper and object, and its scatter without the force's.

    From the first touch on the fingers went `way_mm` more, and the force rose by what it is now
    less what it was then. Both were read with the same gain, so what the gain leaves open is left
    to the force.
    """
    first = int(np.argmax(curve.is_certain))
    touched_mm, first_n = float(curve.width_mm[first]), float(curve.force_n[first])
    way_mm = touched_mm - opening_mm
    if not way_mm > 0:
        return None
    then_n = np.linspace(0.0, 0.95, _FORCES) * force_n
    softness = way_mm / (force_n - then_n)
    likely = normal_density(then_n, first_n, math.hypot(_FIRST_SD * first_n, curve.floor_n))
    if first > 0:
        # One step before without reading, the force was at most a faint one.
        step_mm = float(curve.width_mm[first - 1]) - touched_mm
        most_n = curve.faint_n + step_mm / softness
        doubt_n = np.hypot(curve.floor_n, compliance.residual_mm / softness)
        likely = likely * ndtr((most_n - then_n) / doubt_n)
    if not likely.sum() > 0:
        return None
    mean = float(np.average(np.log(softness), weights=likely))
    spread = float(np.average((np.log(softness) - mean) ** 2, weights=likely))
    return mean, math.hypot(math.sqrt(spread), compliance.residual_mm / way_mm)
