"""The force law of a calibration, as grasps, live views and rigs use it."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibration import Calibration, ForcePairs
from palpate.errors import CalibrationError
from palpate.force.force_follower import ForceFollower, ForceSource
from palpate.force.force_law import ForceLaw
from palpate.force.sheet_follower import SheetFollower
from palpate.force.sheet_law import SheetLaw
from palpate.force.sheet_states import States, compute_states

#: Wait from a movement to the reading of a step of a calibration. The value is not a multiple of
#: the frame interval at 15 Hz, so rounding does not decide which frame is the first after the wait.
DWELL_S = 0.42
#: Time after which the sheet counts as settled (paper, section 2.2).
HORIZON_S = 20.0
#: Duration of a step of the calibration (guess).
_STEP_S = 0.05


def sheet_law_of(calibration: Calibration) -> SheetLaw:
    """Return the force law of a grasp: the stored one, or one fitted to the pairs of an older file.

    Raises
    ------
    CalibrationError
        If the calibration has no force readings at the times that a grasp needs.
    """
    stored = calibration.force_law
    if (stored.get("law"), stored.get("version")) == (SheetLaw.name, SheetLaw.version):
        return SheetLaw.from_dict(stored)
    return fit_sheet_law(calibration.force)


def fit_sheet_law(pairs: ForcePairs) -> SheetLaw:
    """Fit the force law to the pairs of a calibration with a load cell.

    Raises
    ------
    CalibrationError
        As `sheet_law_of`.
    """
    for since_move_s in (DWELL_S, HORIZON_S):
        pairs_at(pairs, since_move_s=since_move_s)
    return SheetLaw.fit(contacts_of(pairs))


def force_law_of(calibration: Calibration) -> SheetLaw | ForceLaw:
    """Return the law of the force at any time of a calibration.

    Dead weights yield settled readings only. The law is then `ForceLaw`, whose prior for the lag of
    a sheet is derived from other sensors. The law of a recording is that of the file, because the
    pairs lack the history of the readings.

    Raises
    ------
    CalibrationError
        As `sheet_law_of`.
    """
    pairs = calibration.force
    if is_made_by_weights(pairs):
        return ForceLaw.fit(list(pairs.excess), force_n=pairs.force_n)
    if is_made_by_recording(pairs):
        return ForceLaw.from_dict(calibration.force_law)
    return sheet_law_of(calibration)


def follow_force(law: SheetLaw | ForceLaw) -> ForceSource:
    """Return a tracker that estimates force from frames alone."""
    return SheetFollower(law) if isinstance(law, SheetLaw) else ForceFollower(law)


def force_now(calibration: Calibration) -> ForceSource:
    """Return a tracker that estimates force from frames alone with the law of a calibration.

    Raises
    ------
    CalibrationError
        As `sheet_law_of`.
    """
    return follow_force(force_law_of(calibration))


def contacts_of(pairs: ForcePairs) -> list[tuple[States, FloatArray]]:
    """Return the states and forces of each placement, as if read from before its contact on.

    The file has a reading soon after each step and one at the end of each hold, in order.
    """
    run, since_s = np.array(pairs.run), np.array(pairs.since_move_s)
    excess = np.array(pairs.pixel_excess if pairs.pixel_excess else pairs.excess)
    excess = excess.reshape(since_s.size, -1)
    found = list[tuple[States, FloatArray]]()
    for placement in np.unique(run):
        mine = run == placement
        before_s = np.append(0.0, since_s[mine][:-1])
        held = since_s[mine] > before_s
        held[0] = False
        interval_s = np.where(held, since_s[mine] - before_s, since_s[mine] + _STEP_S)
        time_s = np.append(0.0, np.cumsum(interval_s))
        read = np.vstack([np.zeros(excess.shape[1]), excess[mine]])
        forces = np.append(0.0, np.array(pairs.force_n)[mine])
        found.append((compute_states(time_s, read), forces))
    return found


def is_made_by_weights(pairs: ForcePairs) -> bool:
    """Return whether a calibration was made with dead weights."""
    return bool(pairs.since_move_s) and bool(np.isclose(pairs.since_move_s, HORIZON_S).all())


def is_made_by_recording(pairs: ForcePairs) -> bool:
    """Return whether a calibration was made from a recording under a moving load."""
    return bool(pairs.since_move_s) and not any(pairs.since_move_s)


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
    if not chosen.any() and is_made_by_recording(pairs):
        raise CalibrationError(
            "the force was calibrated from a recording, which is insufficient for a grasp: run "
            "`palpate calibrate force` with a load cell"
        )
    if not chosen.any():
        read = ", ".join(f"{since:g}" for since in sorted(set(pairs.since_move_s)))
        raise CalibrationError(
            f"force calibration: no pairs read {since_move_s:g} s after a movement (the file has "
            f"{read} s); calibrate the force again"
        )
    return np.array(pairs.excess)[chosen], np.array(pairs.force_n)[chosen]
