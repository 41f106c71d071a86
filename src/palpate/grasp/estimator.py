"""Estimate of the contact, updated with each frame and gripper report."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field, fields
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray, replace_non_finite
from palpate.force.gain import Gain
from palpate.force.sheet_follower import SheetReader
from palpate.grasp.config import READING, SETTLE
from palpate.grasp.plan import Plan
from palpate.grasp.servo_evidence import CurrentSample
from palpate.grasp.sweep import Sweep
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.sensor.array import Frame
from palpate.sensor.pressure_centre import PressureCentres, pressure_centres
from palpate.sensor.sample import Sample, SampleReader
from palpate.signal.relative import finger_means, mean_change

_TIME_S = attrgetter("time_s")
#: Most readings stored since a movement: 20 s at 250 frames/s in full. Beyond it older readings are
#: thinned, so that neither memory nor the time per frame grows in a long hold.
MOST_TOUCHES = 6000


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """A frame and the gripper's state at the same time."""

    frame: Frame
    gripper: GripperState


@dataclass(frozen=True, slots=True, kw_only=True)
class Touch:
    """Readings of one frame, or of the mean of several.

    Attributes
    ----------
    time_s : float
        The frame's own time.
    finger_percent : tuple of float
        Mean relative change of each finger's pixels.
    relative_percent : float
        Mean relative change of all pixels.
    sheet_n, log_sd : float
        Grip force by the sheet's law, newtons, without the gain of this contact; standard deviation
        of its logarithm.
    is_beyond : bool
        Whether a pixel reads more than in the calibration.
    centres : PressureCentres or None
        Pressure centre of each finger; None if the plan does not need it (`Plan.tighten`).
    """

    time_s: float
    finger_percent: tuple[float, ...]
    relative_percent: float
    sheet_n: float
    log_sd: float = 0.0
    is_beyond: bool = False
    centres: PressureCentres | None = None

    @property
    def weakest_percent(self) -> float:
        """Relative change of the least loaded finger; a single loaded finger may only push."""
        return max(self.finger_percent)

    @property
    def strongest_percent(self) -> float:
        """Largest fall: that of any finger, or the mean of all pixels."""
        return min(*self.finger_percent, self.relative_percent)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosingStep:
    """One closing step, read after its dwell; `closure` in mm or kPa."""

    closure: float
    touch: Touch


@dataclass(slots=True, kw_only=True)
class HandMotion:
    """Frames and movements of the whole grasp, carried over between attempts.

    Attributes
    ----------
    began_s : float or None
        Time of the first observation.
    now_s, closure : float
        Time and closure (mm or kPa) of the last observation; 0 before the first.
    frames, skipped, lost, last_sequence : int
        Frames used, frames skipped for newer ones, frames lost, and the last sequence number.
    tracking_lag : float
        Closure minus reported closure, within the error of reports.
    sent : float or None
        Closure of the last command, as returned by the gripper; None before the first.
    moved_s : float
        Start of the last movement.
    still_since_s : float or None
        End of the last movement; None while the gripper moves.
    peak_force_n : float
        Largest grip force so far.
    """

    began_s: float | None = None
    now_s: float = 0.0
    closure: float = 0.0
    frames: int = 0
    skipped: int = 0
    lost: int = 0
    last_sequence: int | None = None
    tracking_lag: float = 0.0
    sent: float | None = None
    moved_s: float = 0.0
    still_since_s: float | None = None
    peak_force_n: float = 0.0

    @property
    def duration_s(self) -> float:
        """Duration of the grasp so far, seconds."""
        return 0.0 if self.began_s is None else self.now_s - self.began_s

    @property
    def period_s(self) -> float:
        """Mean time between frames, seconds."""
        return self.duration_s / max(self.frames - 1, 1)

    @property
    def still_s(self) -> float:
        """Time since the gripper's last movement, seconds."""
        return 0.0 if self.still_since_s is None else self.now_s - self.still_since_s


@dataclass(slots=True, kw_only=True)
class ContactEstimate(HandMotion):
    """Estimate of the contact after a frame; each attempt starts with a new estimate.

    Attributes
    ----------
    rest_ohm : ndarray or None, shape (rows, cols)
        Rest values in use; None until they have been measured.
    rest_frames : tuple of ndarray
        Resistances of the frames before the first movement.
    rest_force_n : float
        Force as which the noise of these frames is read.
    touches : tuple of Touch
        Readings since the end of the last movement, the older ones thinned (`MOST_TOUCHES`).
    strongest_n : float
        Largest force by the sheet's law since the end of the last movement.
    reader : SheetReader or None
        Reads the force from the history of the pixels; None without rest values.
    last : Touch or None
        Readings of the last frame, also during a movement.
    frame_forces : tuple of pairs of float
        Time and grip force of the last frames, each from one frame, also during movements.
    steps : tuple of ClosingStep
        Every step of the closing read so far.
    sweep : Sweep or None
        Present closing at constant speed, if any.
    contact_s : float or None
        Start of the movement that led to contact.
    force_n, force_high_n : float
        Present grip force and its upper bound, from the last closing step.
    damage_low_n : float
        Lower bound of the damage force, from the closing so far.
    current_samples : tuple of CurrentSample
        Servo current during the closing.
    gain : Gain
        Gain of this contact relative to the sheet's law.
    """

    rest_ohm: NDArray[np.float64] | None = None
    rest_frames: tuple[NDArray[np.float64], ...] = ()
    rest_force_n: float = 0.0
    touches: tuple[Touch, ...] = ()
    strongest_n: float = 0.0
    reader: SheetReader | None = None
    last: Touch | None = None
    frame_forces: tuple[tuple[float, float], ...] = ()
    steps: tuple[ClosingStep, ...] = ()
    sweep: Sweep | None = None
    contact_s: float | None = None
    force_n: float = 0.0
    force_high_n: float = 0.0
    damage_low_n: float = math.inf
    current_samples: tuple[CurrentSample, ...] = ()
    gain: Gain = field(default_factory=Gain)

    def start_attempt(self) -> ContactEstimate:
        """Return the estimate for an attempt that starts now, with the hand open."""
        motion = {one.name: getattr(self, one.name) for one in fields(HandMotion)}
        return ContactEstimate(**motion | {"still_since_s": self.now_s})

    @property
    def confirmed_force_n(self) -> float:
        """Smaller grip force of the last two frames, N, to exclude spikes."""
        return min((n for _, n in self.frame_forces[-2:]), default=0.0)

    @property
    def rise_n_per_s(self) -> float:
        """Rate of rise of the confirmed force over the last frames, N/s."""
        if len(self.frame_forces) < READING.fewest_frames:
            return 0.0
        (then_s, then_n), (now_s, _) = self.frame_forces[0], self.frame_forces[-1]
        return max(self.confirmed_force_n - then_n, 0.0) / (now_s - then_s)

    @property
    def now(self) -> Touch:
        """Mean of the last few frames since the last movement."""
        since_s = self.touches[-1].time_s - READING.mean_s
        # Binary search, because a hold has thousands of readings.
        recent = len(self.touches) - bisect_right(self.touches, since_s, key=_TIME_S)
        last = self.touches[-max(READING.fewest_frames, recent) :]
        rows = np.array(
            [(t.sheet_n, t.log_sd, t.relative_percent, *t.finger_percent) for t in last]
        )
        sheet_n, log_sd, relative_percent, *finger_percent = rows.mean(axis=0).tolist()
        return Touch(
            time_s=self.now_s,
            finger_percent=tuple(finger_percent),
            relative_percent=relative_percent,
            sheet_n=sheet_n,
            log_sd=log_sd,
            is_beyond=last[-1].is_beyond,
        )

    def set_force(self, force_n: float, high_n: float) -> None:
        """Set the present force and its upper bound, newtons."""
        self.force_n, self.force_high_n = force_n, high_n
        self.peak_force_n = max(self.peak_force_n, force_n)

    def count_frame(self, frame: Frame) -> None:
        """Count a frame and record its time, without using its readings."""
        gap = 0
        if self.last_sequence is not None:
            gap = frame.sequence - self.last_sequence - 1 - frame.skipped
        self.began_s = frame.time_s if self.began_s is None else self.began_s
        self.now_s, self.last_sequence = frame.time_s, frame.sequence
        self.frames, self.lost = self.frames + 1, self.lost + max(gap, 0)
        self.skipped += frame.skipped

    def update(self, observation: Observation, *, plan: Plan) -> None:
        """Update the estimate with an observation: frame count, movement and readings."""
        frame, gripper = observation.frame, observation.gripper
        self.count_frame(frame)
        if gripper.moving:
            self.still_since_s = None
        elif self.still_since_s is None:
            self.still_since_s = frame.time_s
        reported, sent = plan.gripper.closure(gripper), self.sent
        # Use the command where the report agrees, because reports are rounded.
        error = READING.report_error_steps * plan.resolution
        self.closure = reported
        if sent is not None and not gripper.moving and abs(reported - sent) <= error:
            self.closure = sent
        self.tracking_lag = max(self.closure - reported, 0.0)
        sample = SampleReader(plan.layout, self.rest_ohm).read(frame)
        if self.rest_ohm is None:
            self.rest_frames = (*self.rest_frames, sample.resistance_ohm)
            return
        if self.sweep is not None:
            ratio = _ratio_to_rest(sample.resistance_ohm, self.rest_ohm)
            self.sweep = self._update_sweep(self.sweep, ratio, gripper, plan)
        touch = self.last = self._read_touch(sample, plan)
        frame_forces = (*self.frame_forces, (frame.time_s, self.gain.factor * touch.sheet_n))
        recent = sum(time_s >= frame.time_s - READING.now_s for time_s, _ in frame_forces)
        self.frame_forces = frame_forces[-max(recent, READING.fewest_frames) :]
        if gripper.moving:
            self.touches = ()
            closing = sent is not None and reported < sent and self.contact_s is not None
            if closing and not math.isnan(gripper.current_ma):
                pull = CurrentSample(
                    closure=reported, current_ma=gripper.current_ma, moved_s=self.moved_s
                )
                self.current_samples = (*self.current_samples, pull)
            return
        before = self.strongest_n if self.touches else touch.sheet_n
        self.strongest_n, self.touches = max(before, touch.sheet_n), (*self.touches, touch)
        if len(self.touches) > MOST_TOUCHES:
            half = MOST_TOUCHES // 2
            self.touches = (*self.touches[:half:2], *self.touches[half:])

    def record_command(self, command: GripperCommand, *, plan: Plan) -> None:
        """Record a command that has been sent."""
        self.still_since_s, self.touches, self.moved_s = None, (), self.now_s
        self.sent = closure_of(command.target, plan)

    def _read_touch(self, sample: Sample, plan: Plan) -> Touch:
        """Return the readings of a frame."""
        time_s, change = sample.time_s, sample.change_percent
        fingers = replace_non_finite(finger_means(change, finger_of_row=plan.layout.finger_of_row))
        relative_percent = float(replace_non_finite(mean_change(change)))
        if self.reader is None:
            self.reader = SheetReader(plan.law)
        force = self.reader.follow(time_s, sample.excess, saturated=sample.has_saturated)
        return Touch(
            time_s=time_s,
            finger_percent=tuple(fingers.tolist()),
            relative_percent=relative_percent,
            sheet_n=force.force_n,
            log_sd=float(np.hypot(force.log_sd, SETTLE.drift_sd)),
            is_beyond=force.is_beyond,
            centres=pressure_centres(sample, plan.layout) if plan.tighten else None,
        )

    def _update_sweep(
        self, sweep: Sweep, ratio: FloatArray, gripper: GripperState, plan: Plan
    ) -> Sweep:
        """Return the sweep with this frame added; pixels without a reading count as unchanged."""
        gears_ma = math.nan
        if plan.current is not None and gripper.moving:
            gears_ma = gripper.current_ma - float(
                plan.current.gears.mean_current_ma(np.array(gripper.width_mm))
            )
        watched = ratio if sweep.rows is None else ratio[list(sweep.rows)]
        log_ohm = np.nan_to_num(np.log(watched))
        return sweep.with_frame(gripper.time_s, log_ohm=log_ohm, gears_ma=gears_ma)


def _ratio_to_rest(ohm: FloatArray, rest_ohm: FloatArray) -> FloatArray:
    """Return the resistances relative to rest, 1 for an open or short pixel."""
    return np.divide(ohm, rest_ohm, out=np.ones_like(ohm), where=(ohm > 0) & (ohm < np.inf))


def closure_of(target: float, plan: Plan) -> float:
    """Return the closure of a target."""
    return abs(target - plan.gripper.target(0.0))
