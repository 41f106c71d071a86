"""Result of a grasp: outcome, measurements, events and faults."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from palpate.measurement import Measurement


class Outcome(StrEnum):
    """Outcome of a grasp; `HELD`: the grasp completed.

    The comment of each outcome lists its reasons, with the module that detects them.
    `GraspResult.faults` has the reasons of one grasp. `safety.reaction` defines the movement of the
    hand after a stop.
    """

    #: The hold is over; release was requested after the force was measured (`controller`); or the
    #: paper's method has found a contact in a recorded grasp (`replay_grasp`).
    HELD = "held"
    #: No contact in any of the planned attempts (`approach`), or no contact with the paper's
    #: method in a recording (`replay_grasp`).
    NOTHING_THERE = "nothing_there"
    #: The reading of the hold has disappeared (`monitors`), or did while the grip was tightened
    #: (`tighten`).
    SLIPPED = "slipped"
    #: No safe force is certain to lift the object (`settle`).
    TOO_WEAK = "too_weak"
    #: The sheet shows more than the ceiling, or the board's own ceiling has tripped (`monitors`);
    #: a light touch may already exceed the ceiling according to the calibration (`approach`); the
    #: servo current shows more than the ceiling (`current_monitor`); most loaded pixels are
    #: saturated (`pixel_monitor`).
    FORCE_LIMIT = "force_limit"
    #: The plan's time limit has passed (`monitors`).
    TIMED_OUT = "timed_out"
    #: No frame, an old frame, or an impossible frame (`runner`); implausible rest values, or a grip
    #: of one finger alone (`monitors`); a reading that falls or does not rise while the hand
    #: closes, or rises while it opens (`response_monitor`); open, short, stuck or equal pixels
    #: (`pixel_monitor`); a servo force above that of the sheet (`current_monitor`).
    SENSOR_LOST = "sensor_lost"
    #: The gripper fails or does not answer, is off its target, closes too fast, or reports an
    #: impossible state (`tracking_monitor`, for `runner`); its current is stuck
    #: (`current_monitor`); or this program or a driver fails (`runner`).
    GRIPPER_FAULT = "gripper_fault"
    #: Ctrl-C or a stop request (`runner`), or a release request before the force was measured
    #: (`controller`).
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """An event of a grasp: time (sensor clock), name, and finger if applicable."""

    time_s: float
    name: str
    finger: int | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the JSON form."""
        on = {} if self.finger is None else {"finger": self.finger}
        return {"time_s": self.time_s, "name": self.name, **on}


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspResult:
    """Result of a finished grasp. Quantities that could not be measured are None.

    Attributes
    ----------
    outcome : Outcome
        Outcome of the grasp.
    decision_time_s : float or None
        Time from first contact to the decision.
    settled_percent, size_mm, force_n, stiffness_n_per_mm : Measurement or None
        Mean relative change and grip force at the settling horizon, the object's size before
        contact, and its secant stiffness at that force.
    firmness : Measurement or None
        Index from 0 to 100 (`palpate.object.firmness`) of the stiffness at `firmness_force_n`. It
        has a value and an interval even if the stiffness is only bounded.
    firmness_force_n : float or None
        Force at which the firmness counts, so that it does not depend on the squeeze: 2 N with
        rigid fingers. Soft fingers measure it at their own force.
    previous_width_mm : float or None
        Commanded width one step before contact, not corrected for the gripper's zero. It is the
        size estimate of the paper's method, with its fixed steps, but not of the default method,
        with its variable steps. None for pressure-driven fingers.
    peak_force_n : float or None
        Largest grip force measured during the grasp.
    frames, frames_skipped, frames_lost : int
        Frames used, frames that had waited too long and were skipped for newer ones (before the
        grasp, or because a reply of the gripper took longer than a frame), and frames missing
        from their sequence.
    largest_frame_age_s : float or None
        Largest time from the scan of a frame to its use.
    moments : tuple of Moment
        Events in order: `contact` of both fingers, `adjusted`, `on_target`, `damage_limit` (the
        limit kept the force below the target), `answer`, `tightened` (at a slip), `slip_at_limit`
        (no safe tightening), and the outcome. Events of one finger:
        `finger_contact`, `finger_slip`, `finger_removal`, and `touch` (by a person, on the open
        hand).
    faults : tuple of str
        Reasons for an outcome other than requested, and other failures, such as a recorder's.
    """

    outcome: Outcome
    decision_time_s: float | None = None
    settled_percent: Measurement | None = None
    size_mm: Measurement | None = None
    force_n: Measurement | None = None
    stiffness_n_per_mm: Measurement | None = None
    firmness: Measurement | None = None
    firmness_force_n: float | None = None
    previous_width_mm: float | None = None
    peak_force_n: float | None = None
    frames: int = 0
    frames_skipped: int = 0
    frames_lost: int = 0
    largest_frame_age_s: float | None = None
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
            "firmness_force_n": self.firmness_force_n,
            "previous_width_mm": self.previous_width_mm,
            "peak_force_n": self.peak_force_n,
            "frames": self.frames,
            "frames_skipped": self.frames_skipped,
            "frames_lost": self.frames_lost,
            "largest_frame_age_s": self.largest_frame_age_s,
            "moments": [moment.to_dict() for moment in self.moments],
            "faults": list(self.faults),
        }
