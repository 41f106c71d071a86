"""Width of an item at contact, measured with fingers driven by pressure.

The pressure at contact determines the item's width. A calibration with rigid blocks provides the
closure per pressure and the compliance of the fingers (`palpate.object.compliance`). At small
forces the sheet is inaccurate; at large forces the fingers deflect by centimetres. At 1 N each
error is a few tenths of a millimetre.
"""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.answers import sheet_forces_n
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement
from palpate.object.compliance import SoftFingerCompliance
from palpate_station.records import MEASURED

#: Name of this measurement.
CONTACT_WIDTH = "contact_mm"
#: Grip force at which the width is measured, newtons.
CONTACT_N = 1.0


class ClosingWatch:
    """Collector of controller states of one grasp, for the width at contact."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._hold_state: GraspState | None = None

    def add_state(self, grasp_state: GraspState) -> None:
        """Add the controller's next state."""
        if grasp_state.phase is Phase.HOLD:
            self._hold_state = grasp_state

    def list_measurements(self) -> dict[str, Measurement]:
        """Return the measurements by name; empty if the item was not held or measured."""
        if self._hold_state is None:
            return {}
        width = contact_width(self._hold_state, plan=self.plan)
        return {} if width is None else {CONTACT_WIDTH: width}


def contact_width(grasp_state: GraspState, *, plan: Plan) -> Measurement | None:
    """Return the item's width at 1 N; None without compliance data or below 1 N.

    `grasp_state`: the controller's state at its answer.
    """
    if plan.bend is None or not grasp_state.estimate.steps:
        return None
    estimate = grasp_state.estimate
    force_n = sheet_forces_n(estimate.steps, estimate)
    if force_n.max() < CONTACT_N:
        return None
    ends_n = plan.law.interval_n(force_n, log_sd=estimate.gain.log_sd, level=plan.level)
    pressure_kpa = np.array([plan.gripper.target(step.closure) for step in estimate.steps])
    value, *ends = (
        width_at_contact(pressure_kpa, force_n=one, bend=plan.bend) for one in (force_n, *ends_n)
    )
    width = Measurement(
        value=value,
        low=min(value, *ends),
        high=max(value, *ends),
        unit=MEASURED[CONTACT_WIDTH],
        level=plan.level,
    )
    return width.widened(sd=plan.bend.compliance.residual_mm)


def width_at_contact(
    pressure_kpa: FloatArray, *, force_n: FloatArray, bend: SoftFingerCompliance
) -> float:
    """Return the width (mm) at the last rise of the force above 1 N, interpolated.

    `pressure_kpa`, shape (n,): pressure of each step of a closing.
    `force_n`, shape (n,): measured force at each step.
    `bend`: closure and compliance of the fingers.

    Fingers that close by 1.4 mm per kPa and deflect by 3.5 mm per newton touch a width of 60 mm at
    10 kPa:

    >>> from palpate.object.compliance import Compliance
    >>> compliance = Compliance(slope_mm_per_n=3.5, pad_mm=(0.0,) * 5, zero_mm=-74.0,
    ...     residual_mm=0.1, largest_force_n=12.0)
    >>> force_n = np.array([0.0, 0.4, 2.4])
    >>> pressure_kpa = 10.0 + 3.5 * force_n / 1.4
    >>> bend = SoftFingerCompliance(mm_per_kpa=1.4, compliance=compliance)
    >>> round(width_at_contact(pressure_kpa, force_n=force_n, bend=bend), 6)
    60.0
    """
    width_mm = (
        bend.compliance.deflection_mm(force_n)
        - bend.mm_per_kpa * pressure_kpa
        - bend.compliance.zero_mm
    )
    last = int(np.argmax(force_n))
    below = np.flatnonzero(force_n[: last + 1] < CONTACT_N)
    first = int(below[-1]) if below.size else 0
    around = slice(first, min(first + 2, last + 1))
    return float(np.interp(CONTACT_N, force_n[around], width_mm[around]))
