"""What other witnesses made of one contact: the force believed over what the sheet alone reads.

A servo's current seconds the sheet (`palpate.grasp.contact_gain`). It makes one force truer; but
it errs alike in all grasps of one morning, for the servo is as warm as it is. Kept beside the
force, it can be weighed again when days are compared.
"""

from __future__ import annotations

import math

from palpate.estimate.measurement import Measurement
from palpate.grasp.belief import Belief
from palpate.grasp.plan import Plan
from palpate.normal import normal_half_width
from palpate.produce.records import MEASURED, Grasp

#: Name of this measurement.
NAME = "sheet_gain"


def sheet_gain(belief: Belief, *, plan: Plan) -> Measurement:
    """Return the gain of a contact: 1 where nothing but the sheet was asked.

    Parameters
    ----------
    belief : Belief
        What the controller knew when it gave its answer.
    plan : Plan
        Of that grasp.
    """
    gain = belief.gain
    reach = normal_half_width(plan.level) * gain.log_sd
    return Measurement(
        value=math.exp(gain.log_mean),
        low=math.exp(gain.log_mean - reach),
        high=math.exp(gain.log_mean + reach),
        unit=MEASURED[NAME],
        level=plan.level,
    )


def log_gain(grasp: Grasp) -> float | None:
    """Return the logarithm of the gain that was kept of a grasp; None where none was."""
    kept = grasp.measurements.get(NAME)
    return None if kept is None else math.log(kept.value)
