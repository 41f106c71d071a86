"""Planning of a grasp from a calibration and a task."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate.calibration import BlockPairs, Calibration
from palpate.errors import CalibrationError, InputError
from palpate.force.of_calibration import sheet_law_of
from palpate.force.servo_force import CurrentLaw
from palpate.force.sheet_law import LEAST_N
from palpate.grasp.plan import HOLD_S, LONGEST_S, Plan
from palpate.grasp.safety import FORCE_CEILING_N, MOST_TIGHTENINGS
from palpate.gripper.interface import Gripper
from palpate.object.compliance import Compliance, SoftFingerCompliance
from palpate.object.damage import DamageModel

#: Smallest valid expected size, mm (guess).
LEAST_SIZE_MM = 1.0
#: Pressure-driven fingers: fewest readings on a block; largest slope of the force at another
#: opening relative to that on the block; steps (kPa) and rates (kPa/s) with about the same finger
#: travel as those of a width-driven hand.
_FEWEST, _BEND_MARGIN = 4, 1.3
_PRESSURE_STEPS = {
    "step": 0.8,
    "fine_step": 0.5,
    "smallest_step": 0.1,
    "resolution": 0.1,
    "rate": 15.0,
    "squeeze_rate": 10.0,
    # Their stiffness is estimated from the first and last step only.
    "fewest_steps": 2,
}


def plan_grasp(
    calibration: Calibration,
    *,
    gripper: Gripper,
    target_force_n: float | None = None,
    lift_force_n: float | None = None,
    expect_size_mm: float | None = None,
    damage: DamageModel | None = None,
    kind: str = "",
    tries: int = 1,
    tighten: int = 0,
    hold_s: float = HOLD_S,
    longest_s: float = LONGEST_S,
) -> Plan:
    """Plan a grasp with a calibrated sensor.

    Other fields of `Plan` are for studies of grasping; change them with
    ``dataclasses.replace(plan, gentle_force_n=1.0)``.

    Parameters
    ----------
    calibration : Calibration
        Calibration of the sensor on this gripper.
    gripper : Gripper
        Gripper for the grasp; only its limits are read.
    target_force_n : float, optional
        Target grip force; by default a gentle squeeze, just enough for the measurement.
    lift_force_n : float, optional
        Grip force required for lifting: weight over twice the friction coefficient, with a margin.
    expect_size_mm : float, optional
        Approximate size of the object, for a faster approach.
    damage : DamageModel, optional
        Damage limit learned from closings up to damage.
    kind : str
        Kind of object in the damage model; empty if unknown.
    tries : int
        Number of closing attempts until contact.
    tighten : int
        Largest number of times that the hand tightens a slipping grip; 0 for never.
    hold_s : float
        Hold time between decision and release, seconds.
    longest_s : float
        Time limit of the grasp up to the decision, seconds.

    Raises
    ------
    InputError
        If a force, the expected size or the number of tightenings is out of range.
    CalibrationError
        If the calibration lacks data for this grasp.
    """
    check_target_force(target_force_n, name="target_force_n")
    check_target_force(lift_force_n, name="lift_force_n")
    if expect_size_mm is not None and not LEAST_SIZE_MM <= expect_size_mm < math.inf:
        raise InputError(
            f"expect_size_mm {expect_size_mm:g}: must be at least {LEAST_SIZE_MM:g} mm; correct or "
            "omit it"
        )
    if not 0 <= tighten <= MOST_TIGHTENINGS:
        raise InputError(
            f"tighten {tighten}: must be from 0, which never tightens, to {MOST_TIGHTENINGS}"
        )
    width = gripper.limits.drive == "width"
    fit = _fit_width_compliance if width else _fit_pressure_bend
    return Plan(
        layout=calibration.layout,
        rest_ohm=calibration.rest_ohm,
        law=sheet_law_of(calibration),
        gripper=gripper.limits,
        current=None if calibration.current is None else CurrentLaw.fit(calibration.current),
        target_force_n=target_force_n,
        lift_force_n=lift_force_n,
        expect_size_mm=expect_size_mm,
        damage=damage,
        kind=kind,
        tries=tries,
        tighten=tighten,
        hold_s=hold_s,
        longest_s=longest_s,
        **fit(calibration.block),
    )


def check_target_force(force_n: float | None, *, name: str) -> None:
    """Check that a force is within the range of a calibration; `name` labels the message.

    Raises
    ------
    InputError
        If the force is below the smallest one of a calibration, or exceeds the force ceiling.
    """
    if force_n is not None and not LEAST_N <= force_n <= FORCE_CEILING_N:
        raise InputError(
            f"{name} {force_n:g}: must be at least {LEAST_N:g} N, the smallest force that a "
            f"calibration tells from none, and at most {FORCE_CEILING_N:g} N, the force ceiling"
        )


def _fit_width_compliance(block: BlockPairs) -> dict[str, Any]:
    if len(block.width_mm) != len(block.force_n):
        raise CalibrationError(
            "the calibration's block closings have no widths, and this gripper is width-driven; "
            "calibrate the sensor on this gripper"
        )
    compliance = Compliance.fit(block.force_n, width_mm=block.width_mm, block_mm=block.block_mm)
    return {"compliance": compliance, "steepest_n": compliance.stiffest_n_per_mm}


def _fit_pressure_bend(block: BlockPairs) -> dict[str, Any]:
    force_n, pressure_kpa = np.array(block.force_n), np.array(block.pressure_kpa)
    if force_n.size < _FEWEST or pressure_kpa.size != force_n.size or np.ptp(pressure_kpa) == 0:
        raise CalibrationError(
            "this gripper is pressure-driven: its calibration needs readings of force and "
            f"pressure on a rigid block ({_FEWEST} or more, with different pressures), but has "
            f"{force_n.size} of force and {pressure_kpa.size} of pressure; calibrate the compliance"
        )
    first = np.array(block.block_mm) == block.block_mm[0]
    slope_n_per_kpa = float(np.polyfit(pressure_kpa[first], force_n[first], 1)[0])
    if slope_n_per_kpa <= 0:
        raise CalibrationError(
            "the force on the rigid block does not rise with the pressure; calibrate the "
            "compliance again"
        )
    bend = None
    if np.ptp(block.block_mm) > 0:
        bend = SoftFingerCompliance.fit(pressure_kpa, force_n=force_n, block_mm=block.block_mm)
    steepest_n = _BEND_MARGIN * slope_n_per_kpa
    return {"compliance": None, "bend": bend, "steepest_n": steepest_n, **_PRESSURE_STEPS}
