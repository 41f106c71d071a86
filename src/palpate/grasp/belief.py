"""The controller's knowledge at one moment, and how an observation adds to it."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.gain import Gain
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.grasp.servo_evidence import Pull, pulled
from palpate.grasp.sweep import Sweep
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.sensor.array import Frame
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.events import ContactState, EventKind, watch_contact
from palpate.signal.relative import (
    excess_conductance,
    finger_means,
    mean_change,
    relative_change_percent,
)

#: Errors of a reported width (mm) or pressure (kPa) that are the report's own.
_REPORT = {"width": 0.06, "pressure": 0.3}
#: A movement's spike, and the sheet's first answer to it, are over after this time.
_QUIET_S = 0.3
#: Phases of an open hand: what is felt then is somebody's touch.
_OPEN = (Phase.WAIT,)
#: What is read as "now" is the mean of this many frames, or of all within this time if that is
#: more.
_NOW_FRAMES, _NOW_S = 3, 0.14
#: Fewest frames that show a rise.
_RISE_FRAMES = 3
_TIME_S = attrgetter("time_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """A frame and the gripper's state at the same time."""

    frame: Frame
    gripper: GripperState


@dataclass(frozen=True, slots=True, kw_only=True)
class Touch:
    """One frame, made readable.

    Attributes
    ----------
    time_s : float
        The frame's own time.
    finger_percent : tuple of float
        Mean relative change of each finger's pixels.
    relative_percent : float
        Mean relative change of all pixels.
    reading : float
        What the plan's force laws read: by default the excess conductance summed over pixels.
    """

    time_s: float
    finger_percent: tuple[float, ...]
    relative_percent: float
    reading: float

    @property
    def shared_percent(self) -> float:
        """The fall of the finger that feels less: one alone may only push the object."""
        return max(self.finger_percent)

    @property
    def deepest_percent(self) -> float:
        """The strongest fall: of any finger, or of all pixels."""
        return min(*self.finger_percent, self.relative_percent)


@dataclass(frozen=True, slots=True, kw_only=True)
class Closing:
    """One step of the staircase, read after its dwell; mm or kPa by the gripper's drive."""

    closure: float
    touch: Touch


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """All that the controller remembers.

    Attributes
    ----------
    phase : Phase
        What it is doing.
    since_s : float
        When the phase began.
    rest_ohm : ndarray or None, shape (rows, cols)
        Rest values in use; None until they have been taken.
    rest_frames : tuple of ndarray
        Resistances seen before the first movement.
    proving_from : float or None
        Closure from which on it is being found out whether the rest values are a rest.
    still_since_s : float or None
        End of the last movement; None while the gripper moves.
    touches : tuple of Touch
        Since the last movement ended.
    strongest : float
        Largest reading among them. A long hold has tens of thousands, and this is asked at every
        frame.
    staircase : tuple of Closing
        Every step read so far.
    sweep : Sweep or None
        The way at speed that is being gone.
    swept_to : float
        Closure where the last such way ended; NaN before.
    felt_s : float or None
        When the object was first felt on such a way.
    met : tuple of float or None
        Closure and force where that way ended, if the hand went back from there.
    released_s, memory : float and Touch, or None
        When the hand went back from there, and what the sheet still read where nothing touched.
    contact_s : float or None
        Contact: when the movement that led to it began.
    moved_s : float
        When the last movement began.
    force_n, force_high_n : float
        Grip force now and its upper bound, from the last step read.
    peak_force_n : float
        Largest grip force so far.
    frames_n : tuple of pairs of float
        Time and grip force by each of the last frames alone, the hand moving or not.
    damage_low_n : float
        Lower bound of the force that damages the object, from the closing so far.
    pulls : tuple of Pull
        Servo current at moments of the closing.
    gain : Gain
        How this contact reads against the laws of the sheet.
    again : float
        Closure to come back to, in the phase `ease`.
    sent : float
        Closure last commanded, as the gripper reports that it was sent.
    fingers : tuple of ContactState
        What each finger has felt while the hand stood still.
    tries : int
        Closings that found nothing.
    adjustments : int
        Corrections made towards the target.
    corrected : tuple of float or None
        Closure and force before the last correction upwards.
    next_forecast_s : float
        When the settled value is worth predicting again.
    result : GraspResult
        What is known of the answer so far.
    began_s : float or None
        Time of the first observation.
    now_s, closure : float
        Time of the last observation, and how far the hand was closed, mm or kPa.
    behind : float
        By how much less it reports to be closed, within the report's own errors.
    frames, lost, last_sequence : int
        Frames received, gaps, and the last number.
    """

    phase: Phase = Phase.APPROACH
    since_s: float = 0.0
    rest_ohm: NDArray[np.float64] | None = None
    rest_frames: tuple[NDArray[np.float64], ...] = ()
    proving_from: float | None = None
    still_since_s: float | None = None
    touches: tuple[Touch, ...] = ()
    strongest: float = float("nan")
    staircase: tuple[Closing, ...] = ()
    sweep: Sweep | None = None
    swept_to: float = float("nan")
    felt_s: float | None = None
    met: tuple[float, float] | None = None
    released_s: float | None = None
    memory: Touch | None = None
    contact_s: float | None = None
    moved_s: float = 0.0
    force_n: float = 0.0
    force_high_n: float = 0.0
    peak_force_n: float = 0.0
    frames_n: tuple[tuple[float, float], ...] = ()
    damage_low_n: float = float("inf")
    pulls: tuple[Pull, ...] = ()
    gain: Gain = field(default_factory=lambda: Gain.unknown(law_sd=0.0))
    again: float = float("nan")
    sent: float = float("nan")
    fingers: tuple[ContactState, ...] = ()
    tries: int = 0
    adjustments: int = 0
    corrected: tuple[float, float] | None = None
    next_forecast_s: float = 0.0
    result: GraspResult = field(default_factory=lambda: GraspResult(outcome=Outcome.STOPPED))
    began_s: float | None = None
    now_s: float = 0.0
    closure: float = float("nan")
    behind: float = 0.0
    frames: int = 0
    lost: int = 0
    last_sequence: int | None = None

    @property
    def ended(self) -> bool:
        """Whether nothing more will be commanded."""
        return self.phase is Phase.STOPPED

    @property
    def lasted_s(self) -> float:
        """How long the grasp has taken so far, seconds."""
        return 0.0 if self.began_s is None else self.now_s - self.began_s

    @property
    def period_s(self) -> float:
        """Time from frame to frame, seconds."""
        return self.lasted_s / max(self.frames - 1, 1)

    @property
    def still_s(self) -> float:
        """How long the gripper has stood still, seconds."""
        return 0.0 if self.still_since_s is None else self.now_s - self.still_since_s

    @property
    def watched_n(self) -> float:
        """Grip force that both of the last two frames show, newtons: one alone may be a spike."""
        return min((n for _, n in self.frames_n[-2:]), default=0.0)

    @property
    def rise_n_per_s(self) -> float:
        """How fast the last frames show the force to rise, N/s: one alone may be a spike."""
        if len(self.frames_n) < _RISE_FRAMES:
            return 0.0
        (then_s, then_n), (now_s, _) = self.frames_n[0], self.frames_n[-1]
        return max(self.watched_n - then_n, 0.0) / (now_s - then_s)

    @property
    def now(self) -> Touch:
        """Mean of the last few frames since the last movement."""
        since_s = self.touches[-1].time_s - _NOW_S
        # Times rise; a long hold has thousands, and this is asked at every frame.
        recent = len(self.touches) - bisect_right(self.touches, since_s, key=_TIME_S)
        last = self.touches[-max(_NOW_FRAMES, recent) :]
        return Touch(
            time_s=self.now_s,
            finger_percent=tuple(np.mean([t.finger_percent for t in last], axis=0).tolist()),
            relative_percent=float(np.mean([t.relative_percent for t in last])),
            reading=float(np.mean([t.reading for t in last])),
        )

    def enter(self, phase: Phase, *, note: str | None = None) -> Belief:
        """Begin a phase, and note the moment in the result if `note` names it."""
        belief = self if note is None else self.noted(note)
        return replace(belief, phase=phase, since_s=self.now_s)

    def with_fault(self, words: str) -> Belief:
        """Add a line to what went wrong."""
        return replace(self, result=replace(self.result, faults=(*self.result.faults, words)))

    def noted(self, name: str, *, finger: int | None = None) -> Belief:
        """Note a moment in the result."""
        moment = Moment(time_s=self.now_s, name=name, finger=finger)
        moments = (*self.result.moments, moment)
        return replace(self, result=replace(self.result, moments=moments))


def observed(belief: Belief, observation: Observation, *, plan: Plan) -> Belief:
    """Add an observation: count the frame, follow the movement, read the touch."""
    frame, gripper = observation.frame, observation.gripper
    still_since = belief.still_since_s
    if gripper.moving:
        still_since = None
    elif still_since is None:
        still_since = frame.time_s
    closure = _closure(belief, gripper, plan)
    belief = counted(
        belief,
        frame,
        closure=closure,
        behind=max(closure - plan.gripper.closure(gripper), 0.0),
        still_since_s=still_since,
    )
    ohm = pixel_resistance_ohm(frame.counts, layout=plan.layout, oversampling=frame.oversampling)
    if belief.rest_ohm is None:
        return replace(belief, rest_frames=(*belief.rest_frames, ohm))
    if belief.sweep is not None:
        belief = replace(belief, sweep=_swept(belief.sweep, belief.rest_ohm, ohm, gripper, plan))
    touch = _unremembered(_touch(frame.time_s, ohm, belief, plan), belief)
    frames_n = (*belief.frames_n, (frame.time_s, _frame_n(touch, belief, plan)))
    recent = sum(time_s >= frame.time_s - _NOW_S for time_s, _ in frames_n)
    belief = replace(belief, frames_n=frames_n[-max(recent, _RISE_FRAMES) :])
    if gripper.moving:
        return replace(belief, touches=(), pulls=pulled(belief, gripper, plan))
    strongest = max(belief.strongest, touch.reading) if belief.touches else touch.reading
    return noticed(replace(belief, touches=(*belief.touches, touch), strongest=strongest))


def counted(belief: Belief, frame: Frame, **noted: Any) -> Belief:
    """Count a frame and note its time, and other fields; what it shows is not taken in."""
    gap = 0 if belief.last_sequence is None else frame.sequence - belief.last_sequence - 1
    return replace(
        belief,
        **noted,
        began_s=frame.time_s if belief.began_s is None else belief.began_s,
        now_s=frame.time_s,
        frames=belief.frames + 1,
        lost=belief.lost + max(gap, 0),
        last_sequence=frame.sequence,
    )


def _swept(
    sweep: Sweep,
    rest_ohm: NDArray[np.float64],
    ohm: NDArray[np.float64],
    gripper: GripperState,
    plan: Plan,
) -> Sweep:
    """Return the way at speed with this frame; a pixel that reads nothing has not changed."""
    gears_ma = float("nan")
    if plan.current is not None and gripper.moving:
        gears_ma = gripper.current_ma - float(plan.current.gears.at(np.array(gripper.width_mm)))
    ratio = np.divide(ohm, rest_ohm, out=np.ones_like(ohm), where=(ohm > 0) & (ohm < np.inf))
    watched = ratio if sweep.rows is None else ratio[list(sweep.rows)]
    log_ohm = np.nan_to_num(np.log(watched))
    return sweep.seen(gripper.time_s, log_ohm=log_ohm, gears_ma=gears_ma)


def _closure(belief: Belief, gripper: GripperState, plan: Plan) -> float:
    """Return the closure: as sent where the report agrees, because reports are rounded."""
    reported = plan.gripper.closure(gripper)
    agrees = not gripper.moving and abs(reported - belief.sent) <= _REPORT[plan.gripper.drive]
    return belief.sent if agrees else reported


def commanded(belief: Belief, sent: GripperCommand, *, plan: Plan) -> Belief:
    """Take in what was really sent: grippers clamp commands, and round them to their own steps."""
    return replace(belief, sent=abs(sent.target - plan.gripper.target(0.0)))


def _touch(time_s: float, ohm: NDArray[np.float64], belief: Belief, plan: Plan) -> Touch:
    assert belief.rest_ohm is not None
    change = relative_change_percent(ohm, rest_ohm=belief.rest_ohm)
    fingers = finger_means(change, finger_of_row=plan.layout.finger_of_row)
    # A pixel beyond the converter's range has at least the conductance of its last step.
    readable_ohm = np.maximum(ohm, plan.layout.divider.least_ohm)
    excess = excess_conductance(readable_ohm, rest_ohm=belief.rest_ohm)
    return Touch(
        time_s=time_s,
        finger_percent=tuple(_finite(fingers).tolist()),
        relative_percent=float(_finite(mean_change(change))),
        reading=float(plan.reading.reading(excess)),
    )


def _frame_n(touch: Touch, belief: Belief, plan: Plan) -> float:
    """Return the grip force by one frame: the smaller of what the two laws of the sheet read.

    Whether the load is new or has settled is not known of a frame, and too small an answer stops
    the hand a moment later, not a healthy grasp.
    """
    laws_n = [law.force_n(touch.reading).value for law in (plan.early_law, plan.settled_law)]
    return math.exp(belief.gain.log_mean) * float(min(laws_n))


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `nan_to_num` of values; what is finite already needs none of its many steps."""
    return values if np.isfinite(values).all() else np.nan_to_num(values)


def _unremembered(touch: Touch, belief: Belief) -> Touch:
    """Return a touch without what the sheet remembers of an earlier one.

    Creep fades about as the inverse of the time since.
    """
    memory, released_s = belief.memory, belief.released_s
    if memory is None or released_s is None:
        return touch
    left = (memory.time_s - released_s) / max(touch.time_s - released_s, 1e-3)
    return Touch(
        time_s=touch.time_s,
        finger_percent=tuple(
            now - left * then
            for now, then in zip(touch.finger_percent, memory.finger_percent, strict=True)
        ),
        relative_percent=touch.relative_percent - left * memory.relative_percent,
        reading=touch.reading - left * memory.reading,
    )


def noticed(belief: Belief) -> Belief:
    """Note what single fingers feel while the hand stands still."""
    if belief.still_s < _QUIET_S:
        return belief
    felt = belief.now.finger_percent
    states = belief.fingers or (ContactState(),) * len(felt)
    fingers = []
    for finger, (state, change) in enumerate(zip(states, felt, strict=True)):
        state, kind = watch_contact(state, change)
        fingers.append(state)
        if kind is not None:
            belief = belief.noted(_event_name(belief, kind), finger=finger)
    if belief.fingers == tuple(fingers):
        return belief
    return replace(belief, fingers=tuple(fingers))


def _event_name(belief: Belief, kind: EventKind) -> str:
    if kind is EventKind.CONTACT and belief.phase in _OPEN:
        return "touch"
    return f"finger_{kind}"
