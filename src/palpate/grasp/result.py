"""The result of a grasp: the outcome, the measurements, and how it went."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from palpate.estimate.measurement import Measurement


class Outcome(StrEnum):
    """The outcome of a grasp. `held`: the grasp completed.

    Every reason to end a grasp is listed next to its outcome, with the module that decides it. The
    words of one grasp are in its `GraspResult.faults`; what a stop does to the hand is
    `safety.reaction`.
    """

    #: The hold is over; or the user wanted the object back once its force was known (`controller`);
    #: or the paper's method, reading a recording, gave its answer (`decide_again`).
    HELD = "held"
    #: The hand closed as often as the plan tries without contact (`approach`), or a recording
    #: shows the paper's method no answer (`decide_again`).
    NOTHING_THERE = "nothing_there"
    #: The reading of the hold is gone (`monitors`).
    SLIPPED = "slipped"
    #: No force that is safe for the object is certain to lift it (`settle`).
    TOO_WEAK = "too_weak"
    #: The sheet shows more than the ceiling, or the board's own ceiling has tripped (`monitors`);
    #: by its calibration a faint touch may be more already (`approach`); the servo's current shows
    #: more (`current_monitor`); most of the pressed pixels are beyond what the converter reads
    #: (`pixel_monitor`).
    FORCE_LIMIT = "force_limit"
    #: Not done within the plan's longest time (`monitors`).
    TIMED_OUT = "timed_out"
    #: No frame, only old ones, or one that can't be (`runner`); a rest that is not this sheet's,
    #: one finger alone, or a sheet that shows less while the hand closes (`monitors`); pixels that
    #: are open, short, stuck or read all the same (`pixel_monitor`); a sheet that does not follow
    #: the fingers (`approach`); a servo that pulls more than the sheet shows (`current_monitor`).
    SENSOR_LOST = "sensor_lost"
    #: The gripper does not answer or fails, is not where it was sent, closes too fast or reports
    #: what can't be (`tracking_monitor`, for `runner`); its current sticks (`current_monitor`).
    GRIPPER_FAULT = "gripper_fault"
    #: Ctrl-C, or a request to stop (`runner`), or for the object before its force was known
    #: (`controller`).
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """An event of a grasp: its time (sensor clock), its name, and any finger."""

    time_s: float
    name: str
    finger: int | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the form that commands print."""
        on = {} if self.finger is None else {"finger": self.finger}
        return {"time_s": self.time_s, "name": self.name, **on}


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspResult:
    """One finished grasp. What could not be measured is None, never invented.

    Attributes
    ----------
    outcome : Outcome
        How it ended.
    decision_time_s : float or None
        From first contact to the answer.
    settled_percent, size_mm, force_n, stiffness_n_per_mm : Measurement or None
        Mean relative change and grip force at the settling horizon, the object's extent before
        contact, and its own secant stiffness at that force.
    firmness : Measurement or None
        Index from 0 to 100 (`palpate.estimate.firmness`); a value and an interval also where the
        stiffness is only bounded.
    previous_width_mm : float or None
        Width as sent at the step before the one with contact, without the gripper's zero. By
        the paper's method that step is fixed and this its estimate of size; by palpate's steps
        vary, and it is no estimate. None for fingers driven by pressure.
    peak_force_n : float or None
        Largest grip force that was read during the grasp.
    frames, frames_lost : int
        Frames received, and gaps in their numbering.
    moments : tuple of Moment
        In order: `contact` of both fingers, `adjusted`, `on_target`, `damage_limit` (where it kept
        the force below the target), `answer`, the outcome; and of single fingers `finger_contact`,
        `finger_slip`, `finger_removal`, and `touch` where a hand touched the open fingers.
    faults : tuple of str
        Why it ended otherwise than asked, and other failures: a recorder, a device's message.
    """

    outcome: Outcome
    decision_time_s: float | None = None
    settled_percent: Measurement | None = None
    size_mm: Measurement | None = None
    force_n: Measurement | None = None
    stiffness_n_per_mm: Measurement | None = None
    firmness: Measurement | None = None
    previous_width_mm: float | None = None
    peak_force_n: float | None = None
    frames: int = 0
    frames_lost: int = 0
    moments: tuple[Moment, ...] = ()
    faults: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        quantities = ("size_mm", "force_n", "stiffness_n_per_mm", "firmness", "settled_percent")
        found = [(name, getattr(self, name)) for name in quantities]
        parts = [f"{name} {one.text(digits=2)}" for name, one in found if one is not None]
        return f"GraspResult({', '.join([str(self.outcome), *parts])})"

    @property
    def is_limited(self) -> bool:
        """Whether the damage limit kept the force below the target."""
        return any(moment.name == "damage_limit" for moment in self.moments)

    def to_dict(self) -> dict[str, object]:
        """Return the documented JSON form, without `verdict` and `truth`."""
        measured = {
            name: None if value is None else value.to_dict()
            for name, value in (
                ("settled_percent", self.settled_percent),
                ("size_mm", self.size_mm),
                ("force_n", self.force_n),
                ("stiffness_n_per_mm", self.stiffness_n_per_mm),
                ("firmness", self.firmness),
            )
        }
        return {
            "outcome": str(self.outcome),
            "decision_time_s": self.decision_time_s,
            **measured,
            "previous_width_mm": self.previous_width_mm,
            "peak_force_n": self.peak_force_n,
            "frames": self.frames,
            "frames_lost": self.frames_lost,
            "moments": [moment.to_dict() for moment in self.moments],
            "faults": list(self.faults),
        }
