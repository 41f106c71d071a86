"""Whether the gripper goes where it was sent: what it reports, compared with its command."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.grasp.safety import SafetyLimits
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState

_UNITS = {"width": "mm", "pressure": "kPa"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """One command under way.

    Attributes
    ----------
    target : float
        Where the gripper was sent, mm or kPa.
    due_s : float
        When it must be there.

    Examples
    --------
    >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
    >>> sent = GripperCommand(target=30.0, rate=20.0)
    >>> state = GripperState(time_s=0.0, width_mm=34.0)
    >>> follow = Following.of(sent, state=state, now_s=0.0, limits=limits, safety=SafetyLimits())
    >>> follow.complaint(state, now_s=0.5, limits=limits, safety=SafetyLimits())
    >>> follow.complaint(state, now_s=0.7, limits=limits, safety=SafetyLimits())
    'the gripper was sent to 30.0 mm and reports 34.0 mm; is it blocked, locked or without supply?'
    """

    target: float
    due_s: float

    @classmethod
    def of(
        cls,
        sent: GripperCommand,
        *,
        state: GripperState,
        now_s: float,
        limits: GripperLimits,
        safety: SafetyLimits,
    ) -> Following:
        """Begin to follow a command that was sent at `now_s`, when the gripper was at `state`."""
        way = abs(sent.target - limits.reported(state))
        return cls(target=sent.target, due_s=now_s + way / sent.rate + safety.arrival_s)

    def complaint(
        self, state: GripperState, *, now_s: float, limits: GripperLimits, safety: SafetyLimits
    ) -> str | None:
        """Say what is wrong once the gripper had the time to arrive; None if nothing is."""
        reported = limits.reported(state)
        astray = safety.astray_mm if limits.drive == "width" else safety.astray_kpa
        if now_s < self.due_s or not abs(reported - self.target) > astray:
            return None
        unit = _UNITS[limits.drive]
        return (
            f"the gripper was sent to {self.target:.1f} {unit} and reports {reported:.1f} {unit}; "
            "is it blocked, locked or without supply?"
        )
