"""Safety of a grasp: force ceiling, largest safe step, stale frames, reactions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from palpate.grasp.phases import Phase

#: Largest grip force on an unknown object, newtons. The only definition.
FORCE_CEILING_N = 15.0
#: Largest number of tightenings of a slipping grip; each may double the force, up to the ceiling.
MOST_TIGHTENINGS = 10


class Danger(StrEnum):
    """Reason for ending a grasp early."""

    SENSOR_LOST = "sensor_lost"
    GRIPPER_FAULT = "gripper_fault"
    FORCE_LIMIT = "force_limit"
    STOPPED = "stopped"
    #: The gripper exerts more force than the sheet shows, because the sheet has failed or the
    #: object yields.
    UNSEEN_FORCE = "unseen_force"
    SLIPPED = "slipped"
    TIMED_OUT = "timed_out"

    @property
    def outcome(self) -> str:
        """Outcome of a grasp ended for this reason."""
        return str(Danger.SENSOR_LOST if self is Danger.UNSEEN_FORCE else self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """A detected danger, with a one-line message (may be empty)."""

    danger: Danger
    message: str = ""


class Reaction(StrEnum):
    """Reaction of the gripper to a danger."""

    HOLD_STILL = "hold_still"
    OPEN = "open"


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyLimits:
    """Safety limits of a grasp.

    Attributes
    ----------
    force_ceiling_n : float
        Largest grip force; use a smaller value for delicate produce.
    stale_periods : float
        Age, in frame periods, above which a frame stops the grasp.
    stale_floor_s : float
        Smallest age at which a frame stops the grasp. A busy computer passes the bytes of a port on
        up to 0.3 s late (measured with two busy processes on two cores). Meanwhile the hand ends
        its last safe step, because no further command is sent.
    tracking_tolerance_mm, tracking_tolerance_kpa : float
        Difference between reported and commanded width or pressure, after the arrival time, that
        stops the grasp. Larger than the position error of a loaded servo.
    overshoot_mm, overshoot_kpa : float
        Closing beyond the target that stops the grasp at once. Smaller than
        `tracking_tolerance_mm`, because no load makes a servo close too far.
    arrival_s : float
        Time allowed for arrival, in addition to the travel time at the commanded rate.
    latency_s : float
        Delay with which the gripper's control loop stops at a target.

    Raises
    ------
    ValueError
        If a bound is not positive.

    Examples
    --------
    >>> limits = SafetyLimits()
    >>> limits.stale_after_s(1 / 10), limits.stale_after_s(1 / 250)
    (0.5, 0.3)
    """

    force_ceiling_n: float = FORCE_CEILING_N
    stale_periods: float = 5.0
    stale_floor_s: float = 0.3
    tracking_tolerance_mm: float = 0.5
    tracking_tolerance_kpa: float = 2.0
    overshoot_mm: float = 0.2
    overshoot_kpa: float = 1.5
    arrival_s: float = 0.4
    latency_s: float = 0.02

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        if self.force_ceiling_n > FORCE_CEILING_N:
            raise ValueError(
                f"force_ceiling_n must be at most {FORCE_CEILING_N:g} N, not "
                f"{self.force_ceiling_n:g}: a plan can only lower the ceiling"
            )

    def stale_after_s(self, period_s: float) -> float:
        """Return the age at which frames of period `period_s` are stale, seconds."""
        return max(self.stale_periods * period_s, self.stale_floor_s)


def largest_step(
    *,
    force_high_n: float,
    steepest_n: float,
    damage_low_n: float,
    limits: SafetyLimits,
) -> float:
    """Return the largest closing step within the force ceiling and the damage limit.

    Present upper force + upper stiffness x step stays within the smaller of the ceiling and the
    lower bound of the object's damage limit. The step includes what the hand travels until it has
    stopped: `safety_filter.filter_command` leaves room for it.

    Parameters
    ----------
    force_high_n : float
        Upper bound of the present grip force.
    steepest_n : float
        Upper bound of the rise of force per mm or kPa, of object, pads and fingers in series.
    damage_low_n : float
        Lower bound of the damage force; infinite if unknown.
    limits : SafetyLimits
        The force ceiling.

    Examples
    --------
    >>> import math
    >>> from functools import partial
    >>> limits = SafetyLimits(force_ceiling_n=15.0)
    >>> safe = partial(largest_step, force_high_n=5.0, steepest_n=10.0, limits=limits)
    >>> safe(damage_low_n=math.inf), safe(damage_low_n=8.0)
    (1.0, 0.3)
    """
    room_n = min(limits.force_ceiling_n, damage_low_n) - force_high_n
    return max(0.0, room_n / steepest_n)


#: Dangers that open the hand.
_OPENING = (Danger.FORCE_LIMIT, Danger.UNSEEN_FORCE, Danger.SLIPPED, Danger.TIMED_OUT)


def reaction(
    danger: Danger, *, phase: Phase, drive: Literal["width", "pressure"] = "width"
) -> Reaction:
    """Return the reaction to a danger.

    The hand opens in any phase after excessive force, a force that the sheet does not show, a lost
    object, or a timeout. For other reasons a width-driven hand holds still, because dropping the
    object is damage too. A pressure-driven hand opens: it can't hold without commands from the
    host, and would vent at the heartbeat timeout anyway. An opening is always completed. A failed
    gripper is only commanded to stop.

    Examples
    --------
    >>> reaction(Danger.SENSOR_LOST, phase=Phase.HOLD).value
    'hold_still'
    >>> reaction(Danger.SENSOR_LOST, phase=Phase.HOLD, drive="pressure").value
    'open'
    >>> reaction(Danger.FORCE_LIMIT, phase=Phase.HOLD).value
    'open'
    """
    if danger is Danger.GRIPPER_FAULT:
        return Reaction.HOLD_STILL
    if danger in _OPENING or phase is Phase.RELEASE or drive == "pressure":
        return Reaction.OPEN
    return Reaction.HOLD_STILL
