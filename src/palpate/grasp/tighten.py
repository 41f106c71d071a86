"""A grip that tightens when the held object slips.

The hand is at rest, so the centre of the pressure on each finger moves only if the contact does.
The sheet measures no shear, and its total changes only when the object leaves the pads. The shift
of a contact before it slides (partial slip) is below the noise of the centre in simulation, so a
slip is found once the object slides. An object on the outermost pixels shows no shift.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.answers import forecast, read_force
from palpate.grasp.config import GUARDS, READING, SETTLE, TIGHTEN
from palpate.grasp.estimator import Touch
from palpate.grasp.plan import Plan
from palpate.grasp.result import Outcome
from palpate.grasp.safety_filter import filter_command, quantize_target
from palpate.grasp.state import GraspState, Tightening
from palpate.grasp.step_size import record_step, slope_n
from palpate.gripper.interface import GripperCommand


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """Largest shift of a pressure centre, relative to its limit, and the noise of the centres.

    Attributes
    ----------
    ratio : float
        Shift / (`TIGHTEN.threshold_sd` x noise); above 1 the object slips.
    noise_mm : ndarray, shape (fingers x 2,)
        Noise used: standard deviation of each coordinate in the baseline.
    """

    ratio: float
    noise_mm: FloatArray


def measure_shift(
    touches: Sequence[Touch], *, since_s: float, noise_mm: FloatArray | None = None
) -> Shift | None:
    """Compare the pressure centres of the newest frames with those shortly before.

    For each coordinate c of each finger, with the mean over the last `TIGHTEN.window_s` and mean
    and standard deviation over the baseline B before it,

        ratio = max over c of |mean_window(c) - mean_B(c)| / (k hypot(sd_B(c), rounding(c))),

    k = `TIGHTEN.threshold_sd`, and the rounding of the converter, whose steps a short baseline may
    miss. The baseline ends `TIGHTEN.gap_s` before the newest frame, so that a slip does not count
    as noise, and is at most `TIGHTEN.baseline_s` long. The creep of the sheet scales all pixels of
    a finger alike and cancels in the centre; a slow rest of it cancels in the difference.

    `touches`: readings since the last movement, with `centres`.
    `since_s`: time from which the readings are undisturbed.
    `noise_mm`: noise of an earlier baseline, a lower bound; a short baseline then suffices.

    Returns None while the baseline is too short.
    """
    now_s = touches[-1].time_s
    begin_s, end_s = max(since_s, now_s - TIGHTEN.baseline_s), now_s - TIGHTEN.gap_s
    # Binary search, because a hold has thousands of readings.
    first, last, recent = (
        bisect_left(touches, time_s, key=attrgetter("time_s"))
        for time_s in (begin_s, end_s, now_s - TIGHTEN.window_s)
    )
    short = noise_mm is None and end_s - begin_s < TIGHTEN.least_baseline_s
    if short or last - first < READING.fewest_frames:
        return None
    before, newest = _stack_places(touches[first:last]), _stack_places(touches[recent:])
    centres = touches[-1].centres
    assert centres is not None
    noise = np.hypot(before.std(axis=0), centres.rounding_mm)
    if noise_mm is not None:
        noise = np.maximum(noise, noise_mm)
    shift = np.abs(newest.mean(axis=0) - before.mean(axis=0)) / (TIGHTEN.threshold_sd * noise)
    return Shift(ratio=float(shift.max()), noise_mm=noise)


def _stack_places(touches: Sequence[Touch]) -> FloatArray:
    return np.array([one.centres.place_mm for one in touches if one.centres is not None])


def tighten(state: GraspState, plan: Plan) -> GripperCommand | None:
    """Close further if the held object slips, at most `plan.tighten` times.

    The wanted rise of the grip force is `TIGHTEN.force_fraction` of the present force; with the
    slope of the closing this is a travel, which the safety filter limits like that of every
    command. Without a safe travel the hand holds on. Afterwards the force is measured again.
    """
    estimate, progress = state.estimate, state.tightening
    if not plan.tighten or not estimate.touches:
        return None
    held_n = max(progress.held_n, estimate.strongest_n)
    if progress.is_unread and estimate.still_s >= SETTLE.decide_after_s:
        if estimate.now.sheet_n < GUARDS.lost_fraction * held_n:
            return state.release(plan, Outcome.SLIPPED)
        _measure_again(state, plan)
    # The monitors report an object that has left the hand.
    is_gone = estimate.touches[-1].sheet_n < GUARDS.lost_fraction * held_n
    if progress.count >= plan.tighten or is_gone:
        return None
    since_s = estimate.now_s - estimate.still_s + READING.quiet_s
    shift = measure_shift(estimate.touches, since_s=since_s, noise_mm=progress.noise_mm)
    if shift is None or shift.ratio <= 1.0:
        return None
    _read_present_force(state, plan)
    travel = max(
        TIGHTEN.force_fraction * estimate.force_n / slope_n(estimate, plan), plan.smallest_step
    )
    wanted = GripperCommand(
        target=quantize_target(estimate.closure + travel, plan), rate=plan.gripper.fastest
    )
    command = filter_command(wanted, estimate, plan)
    if command is None:
        progress.count = plan.tighten
        state.record_event("slip_at_limit")
        return None
    state.tightening = Tightening(
        count=progress.count + 1, is_unread=True, held_n=held_n, noise_mm=shift.noise_mm
    )
    state.record_event("tightened")
    return command


def _read_present_force(state: GraspState, plan: Plan) -> None:
    """Update the force from the sheet; the upper bound never falls, as the reading may lag."""
    estimate = state.estimate
    read = read_force(estimate.now, estimate.gain, plan)
    estimate.set_force(read.middle, max(read.high, estimate.force_high_n))


def _measure_again(state: GraspState, plan: Plan) -> None:
    """Measure the settled force of the tightened grip; the time of the answer stays."""
    state.tightening.is_unread = False
    record_step(state.estimate, plan)
    _read_present_force(state, plan)
    decision_time_s = state.result.decision_time_s
    state.set_settled_force(forecast(state.estimate, plan=plan), plan=plan)
    state.result = replace(state.result, decision_time_s=decision_time_s)
