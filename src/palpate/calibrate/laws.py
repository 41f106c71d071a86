"""Force laws of a calibration for grasps and the live view."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.force_follower import ForceFollower, ForceSource
from palpate.estimate.force_law import ForceLaw
from palpate.estimate.force_now import ForceLaws, ForceNow
from palpate.estimate.force_states import CONTACT_EXCESS
from palpate.estimate.pixel_law import PixelReading, PlacementReadings, fit_laws
from palpate.estimate.sheet_creep import SheetCreep
from palpate.estimate.weights_check import score_held_out_loads, score_held_out_placements
from palpate.sensor.calibration import Calibration, ForcePairs

#: Wait from a movement to the reading of a step. The calibration and the grasp must wait equally
#: long, because the sheet lags. The value is not a multiple of the frame interval at 15 Hz, so
#: rounding does not decide which frame is the first after the wait.
DWELL_S = 0.42
#: Time after which the sheet counts as settled (paper, section 2.2).
HORIZON_S = 20.0


def laws_of(pairs: ForcePairs) -> ForceLaws:
    """Return the early and settled force laws, by pixel if the calibration has pixel data.

    Raises
    ------
    CalibrationError
        If the calibration has no force readings at the times that a grasp needs.
    """
    read_at = {since: pairs_at(pairs, since_move_s=since) for since in (DWELL_S, HORIZON_S)}
    if not pairs.pixel_excess:
        early, settled = (PowerForceLaw.fit(x, force_n=f) for x, f in read_at.values())
        return ForceLaws(PixelReading.sum_pixels(), early, settled)
    return ForceLaws(*fit_laws(placements_of(pairs)))


def laws_with_memory(pairs: ForcePairs) -> ForceLaws:
    """Return the laws of a calibration and a law with the sheet's lag, for `ForceNow`.

    Raises
    ------
    CalibrationError
        As `laws_of`.
    """
    excess, force_n = pairs_at(pairs, since_move_s=HORIZON_S)
    # Below the threshold of a contact, the reading has no information on force.
    read = excess > CONTACT_EXCESS
    memory = ForceLaw.fit(excess[read], force_n=force_n[read]) if read.any() else None
    return laws_of(pairs)._replace(memory=memory)


def force_now(pairs: ForcePairs) -> ForceSource:
    """Return a tracker that estimates force from frames alone with the laws of a grasp.

    Dead weights yield settled readings only. The tracker then uses `ForceLaw`, whose prior for the
    lag of a sheet is derived from other sensors.

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


def placements_of(pairs: ForcePairs) -> PlacementReadings:
    """Return the training readings of the laws of a grasp, by placement."""
    since_s = np.array(pairs.since_move_s)
    used = np.isclose(since_s, DWELL_S) | np.isclose(since_s, HORIZON_S)
    return PlacementReadings(
        run=np.array(pairs.run, dtype=float)[used],
        pixel_excess=np.array(pairs.pixel_excess)[used],
        force_n=np.array(pairs.force_n)[used],
        early=np.isclose(since_s, DWELL_S)[used],
    )


def add_force_law(recorded: Calibration) -> Calibration:
    """Return the calibration with its force law and the expected error on a new placement.

    Dead weights yield a `palpate.ForceLaw`; a load cell yields a law of settled readings.

    Raises
    ------
    CalibrationError
        If the force pairs are insufficient for a law.
    """
    pairs = recorded.force
    settled = np.isclose(pairs.since_move_s, HORIZON_S)
    excess, force_n = np.array(pairs.excess)[settled], np.array(pairs.force_n)[settled]
    held_out: dict[str, Any] = {"of": "settled force"}
    if is_made_by_weights(pairs):
        known = ForceLaw.fit(list(excess), force_n=force_n)
        held_out["error_percent"] = score_held_out_loads(excess, force_n=force_n)
        return replace(recorded, force_law=known.as_dict(), held_out=held_out)
    errors = score_held_out_placements(placements_of(pairs))
    held_out |= {"error_percent": errors["settled"], "early_error_percent": errors["early"]}
    law = PowerForceLaw.fit(excess, force_n=force_n)
    return replace(recorded, force_law=law.as_dict(), held_out=held_out)


def pairs_at(pairs: ForcePairs, *, since_move_s: float) -> tuple[FloatArray, FloatArray]:
    """Return excess and force of the pairs read `since_move_s` after a movement.

    Raises
    ------
    CalibrationError
        If there are no such pairs.
    """
    if not pairs.since_move_s:
        raise CalibrationError(
            "the calibration has rest values only, no force: run `palpate calibrate force` "
            "(for grasps with a load cell)"
        )
    chosen = np.isclose(pairs.since_move_s, since_move_s)
    if not chosen.any() and is_made_by_weights(pairs):
        raise CalibrationError(
            "the force was calibrated with dead weights, which is insufficient for a grasp: run "
            "`palpate calibrate force` with a load cell"
        )
    if not chosen.any():
        read = ", ".join(f"{since:g}" for since in sorted(set(pairs.since_move_s)))
        raise CalibrationError(
            f"force calibration: no pairs read {since_move_s:g} s after a movement (the file has "
            f"{read} s); calibrate the force again"
        )
    return np.array(pairs.excess)[chosen], np.array(pairs.force_n)[chosen]


def fit_creep(pairs: ForcePairs, reading: PixelReading) -> SheetCreep | None:
    """Fit the sheet's creep from the last step to the end of each hold."""
    since_s, run = np.array(pairs.since_move_s), np.array(pairs.run)
    excess = np.array(pairs.pixel_excess if pairs.pixel_excess else pairs.excess)
    seen = reading.reading(excess.reshape(since_s.size, 1, -1))
    held = np.flatnonzero(np.isclose(since_s[1:], HORIZON_S) & np.isclose(since_s[:-1], DWELL_S))
    held = held[run[held] == run[held + 1]]
    return SheetCreep.fit(seen[held], settled=seen[held + 1], early_s=DWELL_S, settled_s=HORIZON_S)
