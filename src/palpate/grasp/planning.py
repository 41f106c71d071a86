"""From a calibration and a task to a plan."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate.calibrate.laws import DWELL_S, HORIZON_S, fit_creep, laws_of
from palpate.errors import CalibrationError, InputError
from palpate.estimate.compliance import Compliance, SoftFingerCompliance
from palpate.estimate.damage import DamageModel
from palpate.estimate.servo_force import CurrentLaw
from palpate.grasp.plan import HOLD_S, LONGEST_S, Plan
from palpate.grasp.safety import FORCE_CEILING_N
from palpate.gripper.interface import Gripper
from palpate.sensor.calibration import BlockPairs, Calibration
from palpate.settling.relaxation import Relaxation

#: Expected sizes below this, mm, are taken for a mistake (guess).
LEAST_SIZE_MM = 1.0
#: Pressure-driven fingers: fewest readings on a block; how much steeper than on that block the
#: force may rise at another opening; steps (kPa) and rate (kPa/s) that bend the fingers about as
#: far as the steps of a width-driven hand.
_FEWEST, _BEND_MARGIN = 4, 1.3
_PRESSURE_STEPS = {
    "step": 0.8,
    "fine_step": 0.5,
    "smallest_step": 0.1,
    "resolution": 0.1,
    "rate": 15.0,
    "squeeze_rate": 10.0,
    # Two ends are all that their stiffness is estimated from.
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
    hold_s: float = HOLD_S,
    longest_s: float = LONGEST_S,
) -> Plan:
    """Plan a grasp with a calibrated sensor.

    The fields of `Plan` beyond these options are for those who study grasping:
    ``dataclasses.replace(plan, gentle_force_n=1.0)`` changes it.

    Parameters
    ----------
    calibration : Calibration
        Of the sensor on this gripper.
    gripper : Gripper
        That will do it; only its limits are asked for.
    target_force_n : float, optional
        Grip force to reach; a gentle squeeze, just enough to measure, by default.
    lift_force_n : float, optional
        Grip force that lifting takes: weight over twice the friction, with a margin.
    expect_size_mm : float, optional
        About how thick the object is: the hand comes near faster.
    damage : DamageModel, optional
        Force limit of such objects, learned from closings that ended in damage.
    kind : str
        Kind of object of the damage model; empty if unknown.
    tries : int
        How often to close where nothing is found.
    hold_s : float
        How long to hold after the answer, seconds.
    longest_s : float
        A grasp that has not got its answer by then is given up, seconds.

    Raises
    ------
    InputError
        If a force or the expected size is out of range.
    CalibrationError
        If the calibration lacks what the grasp needs.
    """
    check_target_force(target_force_n, name="target_force_n")
    check_target_force(lift_force_n, name="lift_force_n")
    if expect_size_mm is not None and not LEAST_SIZE_MM <= expect_size_mm < math.inf:
        raise InputError(
            f"expect_size_mm {expect_size_mm:g}: give at least {LEAST_SIZE_MM:g} mm, or leave it "
            "out"
        )
    laws = laws_of(calibration.force)
    found = _fit_width_compliance if gripper.limits.drive == "width" else _fit_pressure_bend
    return Plan(
        layout=calibration.layout,
        rest_ohm=calibration.rest_ohm,
        settled_law=laws.settled,
        early_law=laws.early,
        reading=laws.reading,
        creep=fit_creep(calibration.force, laws.reading),
        gripper=gripper.limits,
        current=None if calibration.current is None else CurrentLaw.fit(calibration.current),
        settling=Relaxation(),
        dwell_s=DWELL_S,
        horizon_s=HORIZON_S,
        target_force_n=target_force_n,
        lift_force_n=lift_force_n,
        expect_size_mm=expect_size_mm,
        damage=damage,
        kind=kind,
        tries=tries,
        hold_s=hold_s,
        longest_s=longest_s,
        **found(calibration.block),
    )


def check_target_force(force_n: float | None, *, name: str) -> None:
    """Refuse a force above the ceiling; `name` appears in the message.

    Raises
    ------
    InputError
        If it is not above 0, or exceeds the force ceiling.
    """
    if force_n is not None and not 0 < force_n <= FORCE_CEILING_N:
        raise InputError(
            f"{name} {force_n:g}: must be above 0 and at most {FORCE_CEILING_N:g} N, the force "
            "ceiling"
        )


def _fit_width_compliance(block: BlockPairs) -> dict[str, Any]:
    if len(block.width_mm) != len(block.force_n):
        raise CalibrationError(
            "the calibration's closings on a block are pressures, and this gripper is driven by "
            "width; calibrate it on this gripper"
        )
    compliance = Compliance.fit(block.force_n, width_mm=block.width_mm, block_mm=block.block_mm)
    return {"compliance": compliance, "steepest_n": compliance.stiffest_n_per_mm}


def _fit_pressure_bend(block: BlockPairs) -> dict[str, Any]:
    force_n, pressure_kpa = np.array(block.force_n), np.array(block.pressure_kpa)
    if force_n.size < _FEWEST or pressure_kpa.size != force_n.size or np.ptp(pressure_kpa) == 0:
        raise CalibrationError(
            f"this gripper is driven by pressure: its calibration needs {_FEWEST} readings of "
            f"pressure and force on a rigid block, and has {pressure_kpa.size}"
        )
    first = np.array(block.block_mm) == block.block_mm[0]
    slope_n_per_kpa = float(np.polyfit(pressure_kpa[first], force_n[first], 1)[0])
    if slope_n_per_kpa <= 0:
        raise CalibrationError("on the rigid block the force must rise with the pressure")
    bend = None
    if np.ptp(block.block_mm) > 0:
        bend = SoftFingerCompliance.fit(pressure_kpa, force_n=force_n, block_mm=block.block_mm)
    steepest_n = _BEND_MARGIN * slope_n_per_kpa
    return {"compliance": None, "bend": bend, "steepest_n": steepest_n, **_PRESSURE_STEPS}
