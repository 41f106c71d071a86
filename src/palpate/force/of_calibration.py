"""The force law of a calibration, as grasps, live views and rigs use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.calibration import Calibration, ForcePairs
from palpate.errors import CalibrationError
from palpate.force.creep_update import EARLY_S
from palpate.force.force_follower import ForceFollower, ForceSource
from palpate.force.force_law import ForceLaw, refuse_reversed
from palpate.force.force_states import CONTACT_EXCESS
from palpate.force.sheet_follower import SheetFollower
from palpate.force.sheet_law import SheetLaw
from palpate.force.sheet_states import States, compute_states
from palpate.sensor.array import ArrayLayout

#: Wait from a movement to the reading of a step of a calibration. The value is not a multiple of
#: the frame interval at 15 Hz, so rounding does not decide which frame is the first after the wait.
DWELL_S = 0.42
#: Time after which the sheet counts as settled (paper, section 2.2).
HORIZON_S = 20.0
#: Duration of a step of the calibration (guess).
_STEP_S = 0.05
#: Factor of the standard deviation of ln force with dead weights, which are too few to measure it,
#: and on flat stamps. Tuned on 109 grasps with three weights on simulated `field` sheets, two
#: stamps and no servo current (seeds from 9600000): 1.2 covers .72 of the forces. docs/force.md
#: scores it on others.
_WEIGHTS_MISFIT = 1.8
#: Scatter of weak forces of weights, newtons: with the 0.3 N of a moving load the law of three
#: weights misses the smallest of them by up to a third, and the intervals of settled forces cover
#: .96 to .98. Chosen on 60 simulated sheets of each level, which benchmarks/weights.py does not
#: score, with a look at the three ladders of study `force-ladders`.
_WEAK_WEIGHTS_N = 0.1
_RETYPE = (
    "give the weights in the order in which they lay on the sensor, and check that each lay on it"
)
#: A pad below this fraction of the reading of the most loaded pad carries no weight.
_LOADED_FRACTION = 0.1


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
    return fit_sheet_law(calibration.force, layout=calibration.layout)


def fit_sheet_law(pairs: ForcePairs, *, layout: ArrayLayout) -> SheetLaw:
    """Fit the force law of a grasp to the pairs of a calibration.

    Dead weights tell the settled reading of each pixel at a few loads, and their early readings the
    creep; the rest is that of other sensors. A load cell tells all but the unloading.

    Raises
    ------
    CalibrationError
        As `sheet_law_of`.
    """
    if is_made_by_weights(pairs) and pairs.pixel_excess:
        weights = settled_pairs(pairs)
        excess = np.maximum(weights.excess, CONTACT_EXCESS)
        refuse_reversed(excess, force_n=weights.force_n, remedy=_RETYPE)
        law = SheetLaw.fit(
            contacts_of(weights, layout=layout),
            misfit=_WEIGHTS_MISFIT,
            weak_n=_WEAK_WEIGHTS_N,
            pads=pads_of(layout),
        )
        return law.learn_creep(contacts_of(pairs, layout=layout))
    for since_move_s in (DWELL_S, HORIZON_S):
        pairs_at(pairs, since_move_s=since_move_s)
    return SheetLaw.fit(contacts_of(pairs, layout=layout))


def fit_summed_law(pairs: ForcePairs) -> ForceLaw:
    """Fit the law of the sum of the pixels to readings of weights.

    Raises
    ------
    CalibrationError
        As `ForceLaw.fit`.
    """
    settled, excess = settled_pairs(pairs), np.array(pairs.excess)
    law = ForceLaw.fit(list(settled.excess), force_n=settled.force_n)
    early = np.flatnonzero(~np.isclose(pairs.since_move_s, HORIZON_S))
    # The settled reading of a weight follows its early one.
    return law.learn_creep(excess[early], settled=excess[early + 1]) if early.size else law


def force_law_of(calibration: Calibration) -> SheetLaw | ForceLaw:
    """Return the law of the force at any time of a calibration.

    Without readings of the pixels, weights tell only the law of their sum, `ForceLaw`. The law of a
    recording is that of the file, because the pairs lack the history of the readings.

    Raises
    ------
    CalibrationError
        As `sheet_law_of`.
    """
    pairs = calibration.force
    if is_made_by_weights(pairs) and not pairs.pixel_excess:
        return fit_summed_law(pairs)
    if is_made_by_recording(pairs):
        return ForceLaw.from_dict(calibration.force_law)
    return sheet_law_of(calibration)


def follow_force(law: SheetLaw | ForceLaw, *, finger_of_row: Sequence[int] = (0,)) -> ForceSource:
    """Return a tracker that estimates force from frames alone.

    `finger_of_row`: finger of each row of the frames, as in `ArrayLayout`.
    """
    if isinstance(law, SheetLaw):
        return SheetFollower(law, finger_of_row=finger_of_row)
    return ForceFollower(law)


def force_now(calibration: Calibration) -> ForceSource:
    """Return a tracker that estimates force from frames alone with the law of a calibration.

    Raises
    ------
    CalibrationError
        As `sheet_law_of`.
    """
    rows = calibration.layout.finger_of_row
    return follow_force(force_law_of(calibration), finger_of_row=rows)


def contacts_of(pairs: ForcePairs, *, layout: ArrayLayout) -> list[tuple[States, FloatArray]]:
    """Return the states and forces of each placement, as if read from before its contact on.

    The file has a reading soon after each step and one at the end of each hold, in order. A grip
    force presses the pads of all fingers; a weight on one pad counts as a grip force that much
    smaller that the other pads would add.
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
        forces = np.array(pairs.force_n)[mine]
        if is_made_by_weights(pairs) and pairs.pixel_excess:
            forces = forces * find_loaded_pads(excess[mine], layout=layout).mean(axis=0)
        found.append((compute_states(time_s, read), np.append(0.0, forces)))
    return found


def pads_of(layout: ArrayLayout) -> NDArray[np.int_]:
    """Return the finger that each pixel is on, shape (pixels,)."""
    return np.repeat(layout.finger_of_row, layout.cols)


def find_loaded_pads(excess: FloatArray, *, layout: ArrayLayout) -> NDArray[np.bool_]:
    """Return which fingers' pads each reading, shape (n, pixels), shows loaded: (fingers, n)."""
    finger = pads_of(layout)
    names = np.unique(finger)
    of_finger = np.stack([excess[:, finger == name].sum(axis=1) for name in names])
    return np.asarray(of_finger > _LOADED_FRACTION * of_finger.max(axis=0))


def is_made_by_weights(pairs: ForcePairs) -> bool:
    """Return whether a calibration was made with dead weights: settled, and possibly early."""
    since_s = np.array(pairs.since_move_s)
    settled = np.isclose(since_s, HORIZON_S)
    return bool(settled.any() and (settled | np.isclose(since_s, EARLY_S)).all())


def settled_pairs(pairs: ForcePairs) -> ForcePairs:
    """Return the settled readings of weights."""
    rows = np.flatnonzero(np.isclose(pairs.since_move_s, HORIZON_S)).tolist()
    columns = {one.name: getattr(pairs, one.name) for one in fields(pairs)}
    # Only the readings of the pixels may be missing.
    return ForcePairs(
        **{name: tuple(each[row] for row in rows if each) for name, each in columns.items()}
    )


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
            "the calibration has the weights' readings of all pixels together, and a grasp needs "
            "those of each: run `palpate calibrate force` with the weights again"
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
