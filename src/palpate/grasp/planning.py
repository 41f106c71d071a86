"""From a calibration to a plan with the controller's force laws."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import CalibrationError, InputError
from palpate.estimate.compliance import Compliance, SoftFingerCompliance
from palpate.estimate.damage import DamageModel
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.force_follower import FollowsForce, ForceFollower
from palpate.estimate.force_law import ForceLaw
from palpate.estimate.force_now import ForceLaws, ForceNow
from palpate.estimate.pixel_law import PixelReading, PlacedReadings, fit_laws
from palpate.estimate.servo_force import CurrentLaw
from palpate.estimate.sheet_creep import OwnCreep
from palpate.estimate.weights_check import score_left_out_loads, score_left_out_placements
from palpate.grasp.plan import HOLD_S, LONGEST_S, Plan
from palpate.grasp.safety import FORCE_CEILING_N
from palpate.gripper.interface import Gripper
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs
from palpate.settling.relaxation import Relaxation

#: A step is read this long after its movement, in the calibration as in the grasp, because the
#: sheet lags and the two readings must lag alike. It is no whole number of frames at 15 Hz, so that
#: rounding never decides which frame is the first after it.
DWELL_S = 0.42
#: When the sheet counts as settled (paper, section 2.2).
HORIZON_S = 20.0
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
        What such objects bear, learned from closings that ended in damage.
    kind : str
        Kind of object that the damage model knows; empty if unknown.
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
        creep=_fit_creep(calibration.force, laws.reading),
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


def laws_of(pairs: ForcePairs) -> ForceLaws:
    """Return the reading with its early and settled law, by pixel if calibrated so.

    Raises
    ------
    CalibrationError
        If the calibration has no readings of force at the times that a grasp needs.
    """
    read_at = {since: pairs_at(pairs, since_move_s=since) for since in (DWELL_S, HORIZON_S)}
    if not pairs.pixel_excess:
        early, settled = (PowerForceLaw.fit(x, force_n=f) for x, f in read_at.values())
        return ForceLaws(PixelReading.sum_pixels(), early, settled)
    return ForceLaws(*fit_laws(placements_of(pairs)))


def laws_with_memory(pairs: ForcePairs) -> ForceLaws:
    """Return the laws of a calibration and one with the sheet's lag, for `ForceNow`.

    Raises
    ------
    CalibrationError
        As `laws_of`.
    """
    excess, force_n = pairs_at(pairs, since_move_s=HORIZON_S)
    return laws_of(pairs)._replace(memory=ForceLaw.fit(excess, force_n=force_n))


def force_now(pairs: ForcePairs) -> FollowsForce:
    """Return the force tracker from frames alone, by the laws of a grasp.

    Dead weights give settled readings only: there it is `ForceLaw`, which knows from other sensors
    how a sheet lags.

    Raises
    ------
    CalibrationError
        As `laws_of`.
    """
    if is_made_by_weights(pairs):
        return ForceFollower(ForceLaw.fit(list(pairs.excess), force_n=pairs.force_n))
    return ForceNow(laws_with_memory(pairs), early_s=DWELL_S, settled_s=HORIZON_S)


def is_made_by_weights(pairs: ForcePairs) -> bool:
    """Return whether a calibration was made with dead weights."""
    return bool(pairs.since_move_s) and bool(np.isclose(pairs.since_move_s, HORIZON_S).all())


def placements_of(pairs: ForcePairs) -> PlacedReadings:
    """Return the readings that the laws of a grasp are fitted to, by placement."""
    since_s = np.array(pairs.since_move_s)
    used = np.isclose(since_s, DWELL_S) | np.isclose(since_s, HORIZON_S)
    return PlacedReadings(
        run=np.array(pairs.run, dtype=float)[used],
        pixel_excess=np.array(pairs.pixel_excess)[used],
        force_n=np.array(pairs.force_n)[used],
        early=np.isclose(since_s, DWELL_S)[used],
    )


def with_force_law(recorded: Calibration) -> Calibration:
    """Return the calibration with its force law and the error to expect of the next placement.

    From dead weights the law is `palpate.ForceLaw`, from a load cell one of settled readings.

    Raises
    ------
    CalibrationError
        If its force pairs can't carry a law.
    """
    pairs = recorded.force
    settled = np.isclose(pairs.since_move_s, HORIZON_S)
    excess, force_n = np.array(pairs.excess)[settled], np.array(pairs.force_n)[settled]
    held_out: dict[str, Any] = {"of": "settled force"}
    if is_made_by_weights(pairs):
        known = ForceLaw.fit(list(excess), force_n=force_n)
        held_out["error_percent"] = score_left_out_loads(excess, force_n=force_n)
        return replace(recorded, force_law=known.as_dict(), held_out=held_out)
    errors = score_left_out_placements(placements_of(pairs))
    held_out |= {"error_percent": errors["settled"], "early_error_percent": errors["early"]}
    law = PowerForceLaw.fit(excess, force_n=force_n)
    return replace(recorded, force_law=law.as_dict(), held_out=held_out)


def _fit_creep(pairs: ForcePairs, reading: PixelReading) -> OwnCreep | None:
    """Return the sheet's creep in each hold, from the last step to the end."""
    since_s, run = np.array(pairs.since_move_s), np.array(pairs.run)
    excess = np.array(pairs.pixel_excess if pairs.pixel_excess else pairs.excess)
    seen = reading.reading(excess.reshape(since_s.size, 1, -1))
    held = np.flatnonzero(np.isclose(since_s[1:], HORIZON_S) & np.isclose(since_s[:-1], DWELL_S))
    held = held[run[held] == run[held + 1]]
    return OwnCreep.fit(seen[held], settled=seen[held + 1], early_s=DWELL_S, settled_s=HORIZON_S)


def _fit_width_compliance(block: BlockPairs) -> dict[str, Any]:
    if len(block.width_mm) != len(block.force_n):
        raise CalibrationError(
            "the calibration's closings on a block are pressures, and this gripper is driven by "
            "width; calibrate it on this gripper"
        )
    give = Compliance.fit(block.force_n, width_mm=block.width_mm, block_mm=block.block_mm)
    return {"give": give, "steepest_n": give.stiffest_n_per_mm}


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
    return {"give": None, "bend": bend, "steepest_n": steepest_n, **_PRESSURE_STEPS}


def pairs_at(
    pairs: ForcePairs, *, since_move_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return excess and force of the pairs that were read this long after the movement.

    Raises
    ------
    CalibrationError
        If there are none.
    """
    if not pairs.since_move_s:
        raise CalibrationError(
            "the calibration has rest values only, and a grasp needs force: run `palpate calibrate "
            "force` with a load cell"
        )
    chosen = np.isclose(pairs.since_move_s, since_move_s)
    if not chosen.any():
        read = ", ".join(f"{since:g}" for since in sorted(set(pairs.since_move_s)))
        raise CalibrationError(
            f"force calibration: no pairs read {since_move_s:g} s after a movement (the file has "
            f"{read} s); calibrate the force again"
        )
    return np.array(pairs.excess)[chosen], np.array(pairs.force_n)[chosen]
