"""How wide an item is where fingers driven by pressure begin to press it.

The pressure at which the fingers meet an item tells its width, once rigid blocks have shown how far
they close per pressure and how far they give way under a force (`palpate.estimate.bend`). Early on
the sheet reads faint forces badly, later on the fingers have given way by centimetres; at one
newton both leave a few tenths of a millimetre open.
"""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.bend import Bend
from palpate.estimate.measurement import Measurement
from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.normal import normal_half_width
from palpate.produce.records import MEASURED

#: Name of this measurement.
NAME = "contact_mm"
#: Grip force at which the width is taken, newtons.
CONTACT_N = 1.0


def contact_width(belief: Belief, *, plan: Plan) -> Measurement | None:
    """Return the item's width under a newton; None by a hand that tells no millimetres.

    Parameters
    ----------
    belief : Belief
        What the controller knew when it gave its answer.
    plan : Plan
        Of that grasp.
    """
    if plan.bend is None or not belief.staircase:
        return None
    readings = [step.touch.reading for step in belief.staircase]
    read = belief.gain.applied(plan.early_law.force_n(readings, level=plan.level))
    if read.value.max() < CONTACT_N:
        return None
    pressure_kpa = np.array([plan.gripper.target(step.closure) for step in belief.staircase])
    value, *ends = (
        width_at_contact(pressure_kpa, force_n=force_n, bend=plan.bend)
        for force_n in (read.value, read.low, read.high)
    )
    doubt_mm = plan.bend.give.residual_mm * normal_half_width(plan.level)
    return Measurement(
        value=value,
        low=value - float(np.hypot(max(value - min(ends), 0.0), doubt_mm)),
        high=value + float(np.hypot(max(max(ends) - value, 0.0), doubt_mm)),
        unit=MEASURED[NAME],
        level=plan.level,
    )


def width_at_contact(pressure_kpa: FloatArray, *, force_n: FloatArray, bend: Bend) -> float:
    """Return the width, mm, at which the force last rose above a newton, between steps in a line.

    Parameters
    ----------
    pressure_kpa : ndarray, shape (n,)
        Steps of a closing.
    force_n : ndarray, shape (n,)
        Force read at each of them.
    bend : Bend
        How the fingers close and give way.

    Examples
    --------
    Fingers that close by 1.4 mm per kPa meet 60 mm at 10 kPa, and give way by 3.5 mm per newton:

    >>> from palpate.estimate.stiffness import Give
    >>> give = Give(slope_mm_per_n=3.5, pad_mm=(0.0,) * 5, zero_mm=-74.0, residual_mm=0.1,
    ...     largest_force_n=12.0)
    >>> force_n = np.array([0.0, 0.4, 2.4])
    >>> pressure_kpa = 10.0 + 3.5 * force_n / 1.4
    >>> bend = Bend(mm_per_kpa=1.4, give=give)
    >>> round(width_at_contact(pressure_kpa, force_n=force_n, bend=bend), 6)
    60.0
    """
    width_mm = bend.give.give_mm(force_n) - bend.mm_per_kpa * pressure_kpa - bend.give.zero_mm
    last = int(np.argmax(force_n))
    below = np.flatnonzero(force_n[: last + 1] < CONTACT_N)
    first = int(below[-1]) if below.size else 0
    around = slice(first, min(first + 2, last + 1))
    return float(np.interp(CONTACT_N, force_n[around], width_mm[around]))
