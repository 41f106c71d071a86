"""Safety of a grasp: force ceiling, largest safe step, stale frames, reactions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from palpate.grasp.phases import Phase

#: Largest grip force on an unknown object, newtons. The only definition.
FORCE_CEILING_N = 15.0


class Danger(StrEnum):
    """Why a grasp is ended from outside its own plan."""

    SENSOR_LOST = "sensor_lost"
    GRIPPER_FAULT = "gripper_fault"
    FORCE_LIMIT = "force_limit"
    STOPPED = "stopped"
    #: The gripper presses more than the sheet shows: the sheet is what failed.
    UNSEEN_FORCE = "unseen_force"
    SLIPPED = "slipped"
    TIMED_OUT = "timed_out"

    @property
    def outcome(self) -> str:
        """The outcome of a grasp that it ends."""
        return str(Danger.SENSOR_LOST if self is Danger.UNSEEN_FORCE else self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """A detected danger, with a line that explains it (may be empty)."""

    danger: Danger
    message: str = ""


class Reaction(StrEnum):
    """The gripper's reaction when it has to stop."""

    HOLD_STILL = "hold_still"
    OPEN = "open"


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyLimits:
    """Bounds of every command of a grasp.

    Attributes
    ----------
    force_ceiling_n : float
        Largest grip force; give a smaller one for produce that is known to be delicate.
    stale_periods : float
        Frames older than this many frame periods stop the grasp.
    stale_floor_s : float
        But never frames younger than this: a scheduler's hiccup is not a lost sensor.
    tracking_tolerance_mm, tracking_tolerance_kpa : float
        A gripper that reports a width or pressure this far from what it was sent to, once it had
        the time to arrive, stops the grasp. More than a loaded servo's error of position.
    overshoot_mm, overshoot_kpa : float
        A gripper that has closed this far beyond where it was sent stops the grasp at once. Less
        than `tracking_tolerance_mm`, because no load makes a servo close too far.
    arrival_s : float
        Time to arrive, beyond what the way takes at the rate sent.
    latency_s : float
        How late a gripper stops at its target: its own control loop.

    Raises
    ------
    ValueError
        If a bound is not positive.

    Examples
    --------
    >>> limits = SafetyLimits()
    >>> limits.stale_after_s(1 / 10), limits.stale_after_s(1 / 250)
    (0.5, 0.1)
    """

    force_ceiling_n: float = FORCE_CEILING_N
    stale_periods: float = 5.0
    stale_floor_s: float = 0.1
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

    def stale_after_s(self, period_s: float) -> float:
        """Return the age at which frames of period `period_s` are stale, seconds."""
        return max(self.stale_periods * period_s, self.stale_floor_s)


def largest_step(
    *,
    force_high_n: float,
    steepest_n: float,
    rate: float,
    damage_low_n: float,
    limits: SafetyLimits,
) -> float:
    """Return the largest closing step that can exceed neither the ceiling nor the damage limit.

    The invariant of every command: upper force now + upper stiffness x (step + speed x latency)
    stays under the smaller of the ceiling and the lower bound of the object's damage limit.

    Parameters
    ----------
    force_high_n : float
        Upper bound of the grip force now.
    steepest_n : float
        Upper bound of the force's rise per mm or kPa: object, pads and fingers in series.
    rate : float
        Speed of the step, mm/s or kPa/s.
    damage_low_n : float
        Lower bound of the force that damages the object; infinite where nothing is known of it.
    limits : SafetyLimits
        The ceiling, and how late the gripper stops.

    Examples
    --------
    >>> import math
    >>> from functools import partial
    >>> limits = SafetyLimits(force_ceiling_n=15.0, latency_s=0.02)
    >>> safe = partial(
    ...     largest_step, force_high_n=5.0, steepest_n=10.0, rate=5.0, limits=limits
    ... )
    >>> round(safe(damage_low_n=math.inf), 6), round(safe(damage_low_n=8.0), 6)
    (0.9, 0.2)
    """
    room_n = min(limits.force_ceiling_n, damage_low_n) - force_high_n
    return max(0.0, room_n / steepest_n - rate * limits.latency_s)


#: Dangers that open the hand.
_OPENING = (Danger.FORCE_LIMIT, Danger.UNSEEN_FORCE, Danger.SLIPPED, Danger.TIMED_OUT)


def reaction(
    danger: Danger, *, phase: Phase, drive: Literal["width", "pressure"] = "width"
) -> Reaction:
    """Return the reaction to a danger.

    Too much force opens the hand, whatever it was doing, and so do a force that the sheet does not
    show, an object that is gone, and a grasp that takes too long. For any other reason a
    width-driven hand holds still: dropping is damage too. A
    pressure-driven one vents: it can't hold without a host that feeds it, so the choice is only
    between now and when the heartbeat runs out. An opening that has begun is completed: half a grip
    is the worst of both. A gripper that failed is only commanded to stop.

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
