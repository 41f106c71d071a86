"""Measurements from a closing: firmness, width at contact, and the gain of the sheet.

**Firmness**, by fingers driven by width. The stiffness in a grasp's answer assumes nothing about
how the object's force rises. Fruit is round: its force goes with the power 3/2 of its deformation
(Hertz). Then the width of every step, with the gripper's own give at that force put back, lies on a
line over F^(2/3), whose slope is the fruit's softness, and where contact began drops out:

    width + give(F) = size - softness F^(2/3).

The reading at the last step before the force rose is no load but the sheet's memory.

**Width at contact**, by fingers driven by pressure. The pressure at which they meet an item gives
its width, once rigid blocks have shown how far they close per pressure and how far they give way
under a force (`palpate.estimate.compliance`). Early on the sheet reads faint forces badly, later on
the fingers have given way by centimetres; at one newton both leave some tenths of a millimetre.

**Gain**: the estimated force over the force that the sheet alone reads. A servo's current supports
the sheet (`palpate.grasp.servo_evidence`). It improves one force, but its error is the same in all
grasps of one morning, because the servo's temperature is. Kept with the force, it can be weighed
again when days are compared.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.estimate.compliance import Compliance, SoftFingerCompliance
from palpate.estimate.measurement import Measurement
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.state import GraspState
from palpate.produce.records import MEASURED, Grasp
from palpate.produce.ripeness.firmness import RIPENESS_N
from palpate.settling.result import Status

#: Names of these measurements.
FIRMNESS, CONTACT_WIDTH, SHEET_GAIN = "firmness_n_per_mm", "contact_mm", "sheet_gain"
#: Hertz: deformation goes with this power of the force.
_POWER = 2.0 / 3.0
#: Scatter of ln force from step to step, and of the settled force against them.
_STEP_SD, _SETTLED_SD = 0.05, 0.04
#: While it is held, fruit relaxes by this much (ln force) against what its closing showed.
_RELAXED, _RELAXED_SD = 0.10, 0.07
#: A width is never known better, mm.
_SHARPEST_MM = 0.03
#: No body is harder than this, mm per N^(2/3): estimates beyond it, from scatter, are set to it.
_HARDEST = 0.05
#: A load below this many standard deviations of faint forces shows nothing, nor one below 1 N,
#: where a sheet's law is at its poorest: closings that began with less scattered up to twice as
#: much.
_FELT, _LEAST_N = 2.0, 1.0
_ROUNDS = 3

#: Grip force at which the width is taken, newtons.
CONTACT_N = 1.0


class ClosingWatch:
    """Watches the closing of one grasp: firmness or width at contact, and the gain."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._held: GraspState | None = None

    def see(self, grasp_state: GraspState) -> None:
        """Add the controller's next state."""
        if grasp_state.phase is Phase.HOLD:
            self._held = grasp_state

    def list_measurements(self) -> dict[str, Measurement]:
        """Return the measurements by name; empty if the item was not held."""
        if self._held is None:
            return {}
        found = {
            FIRMNESS: closing_firmness(self._held, plan=self.plan),
            CONTACT_WIDTH: contact_width(self._held, plan=self.plan),
            SHEET_GAIN: sheet_gain(self._held, plan=self.plan),
        }
        return {name: measured for name, measured in found.items() if measured is not None}


def closing_firmness(grasp_state: GraspState, *, plan: Plan) -> Measurement | None:
    """Return the secant stiffness at 5 N by a Hertz fit of a closing, or None.

    `grasp_state`: the controller's state at its answer.
    """
    force = grasp_state.result.force_n
    if plan.give is None or force is None or force.middle <= 0 or not grasp_state.estimate.steps:
        return None
    readings = [step.touch.reading for step in grasp_state.estimate.steps]
    read_n = np.exp(grasp_state.estimate.gain.log_mean) * plan.early_law.force_n(readings).value
    reach = normal_half_width(plan.level)
    floor_n = float(plan.early_law.force_n(0.0, level=plan.level).high) / reach
    load_n, loaded = _step_loads(read_n, floor_n=floor_n)
    if not loaded.any():
        return None
    width_mm = np.array([plan.gripper.target(step.closure) for step in grasp_state.estimate.steps])
    held_mm = plan.gripper.target(grasp_state.estimate.closure)
    softness, sd = round_softness(
        np.append(width_mm[loaded], held_mm) - plan.give.zero_mm,
        force_n=np.append(load_n[loaded], force.middle),
        floor_n=floor_n,
        give=plan.give,
    )
    low, value, high = (
        RIPENESS_N ** (1.0 - _POWER) / max(softness + off * reach * sd, _HARDEST)
        for off in (1.0, 0.0, -1.0)
    )
    return Measurement(
        value=value,
        low=low,
        high=high,
        unit=MEASURED[FIRMNESS],
        level=plan.level,
        status=force.status if softness > _HARDEST else Status.SATURATED,
    )


def round_softness(
    width_mm: FloatArray, *, force_n: FloatArray, floor_n: float, give: Compliance
) -> tuple[float, float]:
    """Fit the line; return its slope, mm per N^(2/3), and the slope's standard deviation.

    `width_mm`, shape (n,): steps of a closing, zero taken out; the last is where the object was
        held.
    `force_n`, shape (n,): force read at each of them, newtons; the last is the settled one.
    `floor_n`: scatter of faint forces, newtons.
    `give`: of pads, fingers and servo.

    A fruit of 60 mm that takes 4 N at 1 mm and has relaxed by a tenth when it is held:

    >>> give = Compliance(slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.02,
    ...     largest_force_n=15.0)
    >>> force_n = np.array([1.0, 2.5, 4.0, 5.0])
    >>> read_n = force_n * [1.0, 1.0, 1.0, np.exp(-0.1)]
    >>> width_mm = 60.0 - (force_n / 4.0) ** (2 / 3) - 0.2 * read_n
    >>> softness, _ = round_softness(width_mm, force_n=read_n, floor_n=0.05, give=give)
    >>> round(softness**-1.5, 1)
    4.0
    """
    elastic_n = force_n * np.exp([0.0] * (force_n.size - 1) + [_RELAXED])
    touch_mm = width_mm + give.give_mm(force_n)
    give_slope_mm = (give.give_mm(1.01 * force_n) - give.give_mm(force_n)) / 0.01
    doubt = np.hypot(_STEP_SD, floor_n / force_n)
    doubt[-1] = _SETTLED_SD
    relaxed = np.array([0.0] * (force_n.size - 1) + [_RELAXED_SD])
    design = np.column_stack([np.ones_like(elastic_n), -(elastic_n**_POWER)])
    softness = 0.5
    for _ in range(_ROUNDS):
        slope_mm = _POWER * softness * elastic_n**_POWER
        sd_mm = np.sqrt(
            _SHARPEST_MM**2 + ((give_slope_mm + slope_mm) * doubt) ** 2 + (slope_mm * relaxed) ** 2
        )
        weighed = design / sd_mm[:, None]
        found = np.linalg.lstsq(weighed, touch_mm / sd_mm, rcond=None)[0]
        softness = max(float(found[1]), _HARDEST)
    return float(found[1]), float(np.sqrt(np.linalg.pinv(weighed.T @ weighed)[1, 1]))


def _step_loads(read_n: FloatArray, *, floor_n: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the load at each step, and at which steps there surely is one."""
    before = int(np.argmin(read_n[: int(np.argmax(read_n)) + 1]))
    load_n = np.asarray(read_n - read_n[before])
    felt = load_n > max(_FELT * floor_n, _LEAST_N)
    return load_n, (np.arange(read_n.size) > before) & felt


def contact_width(grasp_state: GraspState, *, plan: Plan) -> Measurement | None:
    """Return the item's width at 1 N; None by a hand that measures no millimetres.

    `grasp_state`: the controller's state at its answer.
    """
    if plan.bend is None or not grasp_state.estimate.steps:
        return None
    readings = [step.touch.reading for step in grasp_state.estimate.steps]
    read = grasp_state.estimate.gain.apply_to(plan.early_law.force_n(readings, level=plan.level))
    if read.value.max() < CONTACT_N:
        return None
    pressure_kpa = np.array(
        [plan.gripper.target(step.closure) for step in grasp_state.estimate.steps]
    )
    value, *ends = (
        width_at_contact(pressure_kpa, force_n=force_n, bend=plan.bend)
        for force_n in (read.value, read.low, read.high)
    )
    doubt_mm = plan.bend.give.residual_mm * normal_half_width(plan.level)
    return Measurement(
        value=value,
        low=value - float(np.hypot(max(value - min(ends), 0.0), doubt_mm)),
        high=value + float(np.hypot(max(max(ends) - value, 0.0), doubt_mm)),
        unit=MEASURED[CONTACT_WIDTH],
        level=plan.level,
    )


def width_at_contact(
    pressure_kpa: FloatArray, *, force_n: FloatArray, bend: SoftFingerCompliance
) -> float:
    """Return the width, mm, at which the force last rose above a newton, interpolated.

    `pressure_kpa`, shape (n,): steps of a closing.
    `force_n`, shape (n,): force read at each of them.
    `bend`: how the fingers close and give way.

    Fingers that close by 1.4 mm per kPa meet 60 mm at 10 kPa, and give way by 3.5 mm per newton:

    >>> from palpate.estimate.compliance import Compliance
    >>> give = Compliance(slope_mm_per_n=3.5, pad_mm=(0.0,) * 5, zero_mm=-74.0, residual_mm=0.1,
    ...     largest_force_n=12.0)
    >>> force_n = np.array([0.0, 0.4, 2.4])
    >>> pressure_kpa = 10.0 + 3.5 * force_n / 1.4
    >>> bend = SoftFingerCompliance(mm_per_kpa=1.4, give=give)
    >>> round(width_at_contact(pressure_kpa, force_n=force_n, bend=bend), 6)
    60.0
    """
    width_mm = bend.give.give_mm(force_n) - bend.mm_per_kpa * pressure_kpa - bend.give.zero_mm
    last = int(np.argmax(force_n))
    below = np.flatnonzero(force_n[: last + 1] < CONTACT_N)
    first = int(below[-1]) if below.size else 0
    around = slice(first, min(first + 2, last + 1))
    return float(np.interp(CONTACT_N, force_n[around], width_mm[around]))


def sheet_gain(grasp_state: GraspState, *, plan: Plan) -> Measurement:
    """Return the gain of a contact: 1 if the sheet alone was used.

    `grasp_state`: the controller's state at its answer.
    """
    gain = grasp_state.estimate.gain
    reach = normal_half_width(plan.level) * gain.log_sd
    return Measurement(
        value=math.exp(gain.log_mean),
        low=math.exp(gain.log_mean - reach),
        high=math.exp(gain.log_mean + reach),
        unit=MEASURED[SHEET_GAIN],
        level=plan.level,
    )


def log_gain(grasp: Grasp) -> float | None:
    """Return the logarithm of a grasp's stored gain, or None."""
    kept = grasp.measurements.get(SHEET_GAIN)
    return None if kept is None else math.log(kept.middle)


def normal_half_width(level: float) -> float:
    """Return the half width, in standard deviations, of the central interval of a level.

    `level`: probability of covering, 0 to 1.

    >>> round(normal_half_width(0.9), 3)
    1.645
    """
    return float(ndtri(0.5 + level / 2))
