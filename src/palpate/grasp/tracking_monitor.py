"""Checks that the gripper follows its commands, according to its reports."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.grasp.config import GUARDS
from palpate.grasp.safety import SafetyLimits
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState

_UNITS = {"width": "mm", "pressure": "kPa"}


def find_impossible_value(
    state: GripperState, *, limits: GripperLimits, before: GripperState | None = None
) -> str | None:
    """Describe an impossible value in a gripper's report; None if all are possible.

    >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
    >>> find_impossible_value(GripperState(time_s=0.0, width_mm=30.0), limits=limits)
    >>> find_impossible_value(GripperState(time_s=0.0, width_mm=float("nan")), limits=limits)
    'the gripper reports nan mm; its range is 5 to 74 mm; check its cable and its driver'
    """
    reported, unit = limits.drive_reading(state), _UNITS[limits.drive]
    far = GUARDS.range_fraction * limits.span
    if not limits.lowest - far <= reported <= limits.highest + far:
        return (
            f"the gripper reports {reported:.4g} {unit}; its range is {limits.lowest:g} to "
            f"{limits.highest:g} {unit}; check its cable and its driver"
        )
    unsensed = math.isnan(state.current_ma)
    lost = unsensed and before is not None and not math.isnan(before.current_ma)
    if lost or not (unsensed or abs(state.current_ma) < GUARDS.max_current_ma):
        return (
            f"the gripper reports a current of {state.current_ma:g} mA; check its cable and its "
            "driver"
        )
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandTracking:
    """Tracks the execution of one command.

    `begin`, `target`: position at the command and target, mm or kPa.
    `reach`: how far the hand may have closed by the earlier command before this one took effect.
    `ends_s`, `due_s`: time of arrival at the commanded rate, and latest time of arrival.
    `rate`: commanded speed, mm/s or kPa/s.

    >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
    >>> safety = SafetyLimits()
    >>> sent = GripperCommand(target=30.0, rate=20.0)
    >>> state = GripperState(time_s=0.0, width_mm=34.0)
    >>> tracking = CommandTracking.start(sent, state=state, now_s=0.0, limits=limits, safety=safety)
    >>> tracking.find_fault(state, now_s=0.5, limits=limits, safety=safety)
    >>> tracking.find_fault(state, now_s=0.7, limits=limits, safety=safety)[:57]
    'the gripper was commanded to 30.0 mm and reports 34.0 mm;'

    Overshoot is detected at once:

    >>> past = GripperState(time_s=0.3, width_mm=29.7)
    >>> tracking.find_fault(past, now_s=0.3, limits=limits, safety=safety)
    'the gripper was commanded to 30.0 mm but moved on to 29.7 mm; disconnect its supply'
    """

    begin: float
    reach: float
    target: float
    ends_s: float
    due_s: float
    rate: float

    @classmethod
    def start(
        cls,
        sent: GripperCommand,
        *,
        state: GripperState,
        now_s: float,
        limits: GripperLimits,
        safety: SafetyLimits,
        earlier: CommandTracking | None = None,
        sending_s: float = 0.0,
    ) -> CommandTracking:
        """Start to track a command sent at `now_s`, with the gripper at `state`.

        `earlier`: the command in effect until then.
        `sending_s`: time from the gripper's report to the end of the sending.

        Until the command takes effect, the hand follows the earlier one:

        >>> from functools import partial
        >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
        >>> state = GripperState(time_s=0.0, width_mm=34.0)
        >>> start = partial(CommandTracking.start, now_s=0.0, limits=limits, safety=SafetyLimits())
        >>> closing = start(GripperCommand(target=30.0, rate=20.0), state=state)
        >>> stopping = GripperCommand(target=34.0, rate=20.0)
        >>> start(stopping, state=state, earlier=closing, sending_s=0.03).reach
        33.0
        """
        begin = limits.drive_reading(state)
        ends_s = now_s + abs(sent.target - begin) / sent.rate
        reach = begin
        if earlier is not None:
            coasted = earlier.rate * (max(sending_s, 0.0) + safety.latency_s)
            left = earlier.target - begin
            reach += math.copysign(min(coasted, abs(left)), left)
        return cls(
            begin=begin,
            reach=reach,
            target=sent.target,
            ends_s=ends_s,
            due_s=ends_s + safety.arrival_s,
            rate=sent.rate,
        )

    def poll_interval_s(
        self, *, now_s: float, limits: GripperLimits, safety: SafetyLimits
    ) -> float | None:
        """Return the interval of checks during a closing movement; None after its end.

        It is the time in which the hand could exceed its target by the overshoot limit. For a
        pressure-driven hand, checks at frames suffice.
        """
        closes = limits.drive == "width" and self.target < self.begin
        every_s = safety.overshoot_mm / self.rate
        return every_s if closes and now_s <= self.ends_s + 2 * every_s else None

    def is_continued_by(self, later: GripperCommand) -> bool:
        """Return whether a later command leads at least as far in the same direction.

        >>> tracking = CommandTracking(
        ...     begin=40.0, reach=40.0, target=30.0, ends_s=0.5, due_s=0.9, rate=20.0
        ... )
        >>> [
        ...     tracking.is_continued_by(GripperCommand(target=mm, rate=20.0))
        ...     for mm in (28.0, 30.0, 39.0)
        ... ]
        [True, True, False]
        """
        return (later.target - self.target) * (self.target - self.begin) >= 0

    def is_idle(
        self, state: GripperState, *, now_s: float, limits: GripperLimits, least: float
    ) -> bool | None:
        """Return whether the hand has not moved; None if the expected travel is below `least`.

        >>> from functools import partial
        >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
        >>> tracking = CommandTracking(
        ...     begin=40.0, reach=40.0, target=30.0, ends_s=0.5, due_s=0.9, rate=20.0
        ... )
        >>> resting = GripperState(time_s=0.0, width_mm=40.0)
        >>> is_idle = partial(tracking.is_idle, limits=limits, least=0.4)
        >>> [is_idle(resting, now_s=now_s) for now_s in (0.004, 0.1)]
        [None, True]
        >>> is_idle(GripperState(time_s=0.1, width_mm=38.5), now_s=0.1)
        False
        """
        travel = self.target - self.begin
        remaining = max(self.ends_s - now_s, 0.0) * self.rate
        expected = abs(travel) - min(remaining, abs(travel))
        if expected < least:
            return None
        made = math.copysign(1.0, travel) * (limits.drive_reading(state) - self.begin)
        return made / expected < GUARDS.idle_fraction

    def find_fault(
        self, state: GripperState, *, now_s: float, limits: GripperLimits, safety: SafetyLimits
    ) -> str | None:
        """Return a message if the hand overshot its target or has not arrived; else None."""
        reported, unit = limits.drive_reading(state), _UNITS[limits.drive]
        overshoot = safety.overshoot_mm if limits.drive == "width" else safety.overshoot_kpa
        closing = -1.0 if limits.drive == "width" else 1.0
        furthest = closing * max(closing * at for at in (self.begin, self.reach, self.target))
        if closing * (reported - furthest) > overshoot:
            return (
                f"the gripper was commanded to {self.target:.1f} {unit} but moved on to "
                f"{reported:.1f} {unit}; disconnect its supply"
            )
        if now_s < self.due_s or not abs(reported - self.target) > _tolerance(limits, safety):
            return None
        remedy = "check for a blockage, a locked servo or a missing supply"
        if limits.drive == "width":
            # Without an object in the way, its own settings can be the cause.
            remedy += (
                ", and the limits of travel stored in it"
                if self.target < self.begin
                else ", and the zero position of the gripper"
            )
        return (
            f"the gripper was commanded to {self.target:.1f} {unit} and reports "
            f"{reported:.1f} {unit}; {remedy}"
        )


def _tolerance(limits: GripperLimits, safety: SafetyLimits) -> float:
    """Return the allowed difference between command and report, mm or kPa."""
    if limits.drive == "width":
        return safety.tracking_tolerance_mm
    return safety.tracking_tolerance_kpa


class SpeedMonitor:
    """Compares the speed of a closing hand with its commands.

    A short step may end between two reports. The excess travel is therefore accumulated over
    commands, and reduced by the travel that the elapsed time allows.

    >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
    >>> monitor = SpeedMonitor(limits, safety=SafetyLimits())
    >>> sent = GripperCommand(target=30.0, rate=20.0)
    >>> at = lambda time_s, mm: GripperState(time_s=time_s, width_mm=mm)
    >>> tracking = CommandTracking.start(
    ...     sent, state=at(0.0, 50.0), now_s=0.0, limits=limits, safety=SafetyLimits()
    ... )
    >>> monitor.find_fault(at(0.0, 50.0), tracking=None)
    >>> monitor.find_fault(at(0.1, 48.0), tracking=tracking)
    >>> monitor.find_fault(at(0.2, 42.0), tracking=tracking)
    "the gripper was commanded to 20.0 mm/s and closes at 60 mm/s; check the driver's unit of speed"
    """

    def __init__(self, limits: GripperLimits, *, safety: SafetyLimits) -> None:
        self._limits, self._latency_s = limits, safety.latency_s
        # A loaded servo catches up with its tracking error at once when the load disappears.
        self._lag = _tolerance(limits, safety)
        #: Time of the last report, time of its request, and closure.
        self._before: tuple[float, float, float] | None = None
        self._rate = self._ahead = 0.0

    def find_fault(
        self, state: GripperState, *, tracking: CommandTracking | None, asked_s: float | None = None
    ) -> str | None:
        """Process the next report; return a message if the hand closes too fast.

        `tracking`: the command in effect since the last report, if any.
        `asked_s`: time of the request of the report; its own time by default. A report delayed
            after its measurement would otherwise make the next movement look faster.
        """
        closure, before = self._limits.closure(state), self._before
        if before is not None and not state.time_s > before[0]:
            return None
        self._before = (state.time_s, state.time_s if asked_s is None else asked_s, closure)
        if before is None or tracking is None:
            return None
        closed, passed_s = closure - before[2], state.time_s - min(before[:2])
        # After a slower command, the hand continues briefly at the previous speed.
        late = max(self._rate - tracking.rate, 0.0) * self._latency_s
        self._rate = tracking.rate
        more = closed - GUARDS.max_speed_ratio * tracking.rate * passed_s
        self._ahead = max(self._ahead - late + more, min(self._ahead, 0.0) - late)
        if self._ahead <= self._lag + tracking.rate * self._latency_s:
            return None
        unit = _UNITS[self._limits.drive]
        return (
            f"the gripper was commanded to {tracking.rate:.1f} {unit}/s and closes at "
            f"{closed / passed_s:.0f} {unit}/s; check the driver's unit of speed"
        )
