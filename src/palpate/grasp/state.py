"""State of a grasp, shared by its phases and passed to watchers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from palpate.arrays import FloatArray
from palpate.grasp.answers import measure_force
from palpate.grasp.config import READING
from palpate.grasp.estimator import ContactEstimate
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.grasp.servo_evidence import gripper_force
from palpate.grasp.step_size import slope_n
from palpate.gripper.interface import GripperCommand
from palpate.measurement import Measurement
from palpate.object.relaxation import settle_force
from palpate.signal.events import ContactState, EventKind, watch_contact


@dataclass(slots=True, kw_only=True)
class Attempt:
    """Progress of one closing attempt.

    Attributes
    ----------
    activity : Activity
        Present activity of the approach.
    rest_check_from : float or None
        Closure at which the check of the rest values started (`rest.verify_rest`); None without.
    sweep_end : float or None
        Closure at the end of the last sweep; None before.
    sweep_contact_s : float or None
        Time of the contact in a sweep.
    fingers : tuple of ContactState
        Contact state of each finger, updated while the hand is at rest.
    """

    activity: Activity = Activity.TOUCH
    rest_check_from: float | None = None
    sweep_end: float | None = None
    sweep_contact_s: float | None = None
    fingers: tuple[ContactState, ...] = ()


@dataclass(slots=True, kw_only=True)
class Correction:
    """Progress of the corrections towards the target.

    Attributes
    ----------
    activity : Activity
        Present activity: wait for a forecast, select a correction, or close again from below.
    present : Measurement or None
        Force at the last answer; None before it.
    count : int
        Number of corrections so far.
    before : tuple of float or None
        Closure and force before the last upward correction.
    return_closure : float or None
        Target closure after easing; None if the hand never eased.
    """

    activity: Activity = Activity.FORECAST
    present: Measurement | None = None
    count: int = 0
    before: tuple[float, float] | None = None
    return_closure: float | None = None


@dataclass(slots=True, kw_only=True)
class Tightening:
    """Progress of a hand that tightens at a slip (`palpate.grasp.tighten`).

    Attributes
    ----------
    count : int
        Number of times that the hand has tightened.
    is_unread : bool
        Whether the force of the tightened grip has not yet been measured.
    held_n : float
        Largest reading of the sheet before the last tightening, newtons.
    noise_mm : ndarray or None
        Noise of the pressure centres in this hold; None before the first tightening.
    """

    count: int = 0
    is_unread: bool = False
    held_n: float = 0.0
    noise_mm: FloatArray | None = None


@dataclass(slots=True, kw_only=True)
class GraspState:
    """State of a grasp. Watchers receive a snapshot after each frame.

    Attributes
    ----------
    phase : Phase
        Present phase.
    since_s : float
        Start of the present phase or activity.
    estimate : ContactEstimate
        Estimate of the contact.
    attempt, correction : Attempt and Correction
        Progress within the phases `approach` and `settle`.
    tightening : Tightening
        Progress of the tightening while holding.
    attempts : int
        Number of attempts without contact.
    result : GraspResult
        Result so far.
    """

    phase: Phase = Phase.APPROACH
    since_s: float = 0.0
    estimate: ContactEstimate = field(default_factory=ContactEstimate)
    attempt: Attempt = field(default_factory=Attempt)
    correction: Correction = field(default_factory=Correction)
    tightening: Tightening = field(default_factory=Tightening)
    attempts: int = 0
    result: GraspResult = field(default_factory=lambda: GraspResult(outcome=Outcome.STOPPED))

    @property
    def has_ended(self) -> bool:
        """Whether the grasp has ended."""
        return self.phase is Phase.DONE

    @property
    def activity(self) -> Activity | Phase:
        """The activity within the phase, or the phase if it has none."""
        if self.phase is Phase.APPROACH:
            return self.attempt.activity
        return self.correction.activity if self.phase is Phase.SETTLE else self.phase

    @property
    def phase_time_s(self) -> float:
        """Duration of the present phase or activity, seconds."""
        return self.estimate.now_s - self.since_s

    @property
    def first_contact_s(self) -> float:
        """Time of the first contact; without contact, of the last movement."""
        times_s = (self.attempt.sweep_contact_s, self.estimate.contact_s, self.estimate.moved_s)
        return next(time_s for time_s in times_s if time_s is not None)

    @property
    def final_result(self) -> GraspResult:
        """Result including frame counts and peak force."""
        estimate = self.estimate
        return replace(
            self.result,
            frames=estimate.frames,
            frames_skipped=estimate.skipped,
            frames_lost=estimate.lost,
            peak_force_n=estimate.peak_force_n if estimate.contact_s is not None else None,
        )

    def snapshot(self) -> GraspState:
        """Return a copy that later frames do not change."""
        return replace(
            self,
            estimate=replace(self.estimate),
            attempt=replace(self.attempt),
            correction=replace(self.correction),
            tightening=replace(self.tightening),
        )

    def enter(self, phase: Phase | Activity, *, event: str | None = None) -> None:
        """Start a phase or activity; `event`: name of an event to record."""
        if event is not None:
            self.record_event(event)
        self.since_s = self.estimate.now_s
        if isinstance(phase, Phase):
            self.phase = phase
        elif self.phase is Phase.SETTLE:
            self.correction.activity = phase
        else:
            self.phase, self.attempt.activity = Phase.APPROACH, phase

    def record_event(self, name: str, *, finger: int | None = None) -> None:
        """Record an event in the result."""
        moment = Moment(time_s=self.estimate.now_s, name=name, finger=finger)
        self.result = replace(self.result, moments=(*self.result.moments, moment))

    def add_fault(self, message: str) -> None:
        """Add a message to the faults of the result."""
        self.result = replace(self.result, faults=(*self.result.faults, message))

    def release(self, plan: Plan, outcome: Outcome) -> GripperCommand:
        """End the grasp with an outcome; return the command that opens the hand."""
        self.result = replace(self.result, outcome=outcome)
        self.estimate.sent, self.estimate.still_since_s, self.estimate.touches = 0.0, None, ()
        self.enter(Phase.RELEASE, event=outcome.value)
        return GripperCommand(target=plan.gripper.target(0.0), rate=plan.gripper.fastest)

    def record_finger_events(self) -> None:
        """Record contact events of single fingers while the hand is at rest."""
        if self.estimate.still_s < READING.quiet_s or not self.estimate.touches:
            return
        found = []
        for finger, change in enumerate(self.estimate.now.finger_percent):
            before = self.attempt.fingers[finger] if self.attempt.fingers else ContactState()
            after, kind = watch_contact(before, change)
            found.append(after)
            if kind is not None:
                # A contact while the hand waits open is a touch by a person.
                touch = kind is EventKind.CONTACT and self.activity is Activity.WAIT
                self.record_event("touch" if touch else f"finger_{kind}", finger=finger)
        self.attempt.fingers = tuple(found)

    def set_settled_force(self, settled_percent: Measurement, *, plan: Plan) -> Measurement:
        """Compute present and settled force, store both, and return the settled one."""
        measured = gripper_force(self.estimate, plan)
        present = measure_force(self.estimate.now, measured=measured, plan=plan)
        # The slope of the closing is that of object and hand in series.
        share = 1.0 - slope_n(self.estimate, plan) / plan.steepest_n
        self.correction.present, force = present, settle_force(present, share=share)
        self.estimate.peak_force_n = max(self.estimate.peak_force_n, present.middle)
        self.result = replace(
            self.result,
            decision_time_s=round(self.estimate.now_s - self.first_contact_s, 6),
            settled_percent=settled_percent,
            force_n=force,
            peak_force_n=self.estimate.peak_force_n,
        )
        return force
