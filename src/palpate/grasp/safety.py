"""What keeps a grasp safe: the ceiling, the largest safe step, stale frames, what a stop means."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from palpate.grasp.phases import Phase

#: The most that a finger may press on an object of which nothing is known. The only definition.
FORCE_CEILING_N = 15.0


class Danger(StrEnum):
    """Why a grasp is ended from outside its own plan."""

    SENSOR_LOST = "sensor_lost"
    FORCE_LIMIT = "force_limit"
    STOPPED = "stopped"


class Reaction(StrEnum):
    """What the gripper does when it has to stop."""

    HOLD_STILL = "hold_still"
    OPEN = "open"


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyLimits:
    """Bounds that no plan can exceed.

    Attributes
    ----------
    force_ceiling_n : float
        Largest grip force; give a smaller one for produce that is known to be delicate.
    stale_periods : float
        Frames older than this many frame periods stop the grasp.
    stale_floor_s : float
        But never frames younger than this: a scheduler's hiccup is not a lost sensor.

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

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")

    def stale_after_s(self, period_s: float) -> float:
        """Return the age at which frames that should come every `period_s` are stale, seconds."""
        return max(self.stale_periods * period_s, self.stale_floor_s)


def largest_step_mm(
    *, force_high_n: float, stiffness_high_n_per_mm: float, ceiling_n: float
) -> float:
    """Return the largest closing step that can't exceed the ceiling.

    The invariant of every command: upper force now + upper stiffness x step <= ceiling. A servo
    that is sent to a width stops there by itself, so latency adds nothing to a step; a gripper that
    closes continuously must add speed x latency to it.

    Parameters
    ----------
    force_high_n : float
        Upper bound of the grip force now.
    stiffness_high_n_per_mm : float
        Upper bound of the slope of force over closing: object, pads and fingers in series.
    ceiling_n : float
        The smaller of the ceiling and the lower bound of the object's damage limit.

    Examples
    --------
    >>> largest_step_mm(force_high_n=5.0, stiffness_high_n_per_mm=10.0, ceiling_n=15.0)
    1.0
    >>> largest_step_mm(force_high_n=20.0, stiffness_high_n_per_mm=10.0, ceiling_n=15.0)
    0.0
    """
    return max(0.0, (ceiling_n - force_high_n) / stiffness_high_n_per_mm)


def reaction(danger: Danger, *, phase: Phase) -> Reaction:
    """Return what a stop means.

    Too much force opens the hand, whatever it was doing. For any other reason it holds still:
    dropping is damage too. An opening that has begun is completed: half a grip is the worst of
    both.

    Examples
    --------
    >>> reaction(Danger.SENSOR_LOST, phase=Phase.HOLD).value
    'hold_still'
    >>> reaction(Danger.FORCE_LIMIT, phase=Phase.HOLD).value
    'open'
    """
    if danger is Danger.FORCE_LIMIT or phase is Phase.RELEASE:
        return Reaction.OPEN
    return Reaction.HOLD_STILL
