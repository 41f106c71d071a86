"""Any object that moves a gripper by width, as a gripper."""

from __future__ import annotations

import math
from typing import Protocol

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, InputError, PalpateError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState

#: Rate of an object that states none, mm/s (guess: a slow hobby gripper).
_RATE_MM_PER_S = 50.0
#: Change of the width that is a movement, mm, and time without one after which the hand is at
#: rest, s.
_MOVED_MM, _REST_S = 0.05, 0.1


class MovedByWidth(Protocol):
    """What a gripper needs at least; all widths in mm.

    Optional attributes: `lowest_mm`, `highest_mm` (range of the opening; by default 0, and the
    width when the rig is opened), `fastest_mm_s`, `slowest_mm_s`, `current_ma`, `is_moving`, and a
    method `close`.
    """

    @property
    def width_mm(self) -> float:
        """Present opening, as measured by the gripper."""
        ...

    def move(self, width_mm: float, speed_mm_s: float) -> object:
        """Start a movement to an opening; it does not wait."""
        ...

    def stop(self) -> object:
        """Stop in place."""
        ...


class PlainGripper:
    """A gripper made of an object with `width_mm`, `move` and `stop` (`MovedByWidth`).

    Without `is_moving`, the gripper counts as moving until its width has not changed for 0.1 s.
    Errors of the object are raised as `DeviceError`, so that a grasp ends with their text.

    Raises `InputError` if the object lacks one of them, or its range or rate is not valid.

    Examples
    --------
    >>> class Rack:
    ...     width_mm = 60.0
    ...     def move(self, width_mm, speed_mm_s): self.width_mm = width_mm
    ...     def stop(self): pass
    >>> hand = PlainGripper(Rack())
    >>> hand.command(GripperCommand(target=90.0, rate=10.0)).target, hand.state().width_mm
    (60.0, 60.0)
    """

    def __init__(self, hand: MovedByWidth, *, clock: Clock | None = None) -> None:
        missing = [name for name in ("width_mm", "move", "stop") if not _has(hand, name)]
        if missing:
            raise InputError(
                f"{type(hand).__name__} has no {' and no '.join(missing)}; a gripper needs "
                "width_mm, move(width_mm, speed_mm_s) and stop()"
            )
        self._hand, self._clock = hand, RealClock() if clock is None else clock
        self._last_mm = self._read_width()
        self._moved_s = -math.inf
        self.limits = GripperLimits(
            drive="width",
            lowest=self._stated("lowest_mm", 0.0),
            highest=self._stated("highest_mm", self._last_mm),
            fastest=self._stated("fastest_mm_s", _RATE_MM_PER_S),
            slowest=self._stated("slowest_mm_s", 0.0),
        )
        limits = self.limits
        if not 0 <= limits.lowest < limits.highest or not 0 <= limits.slowest <= limits.fastest:
            raise InputError(
                f"{type(hand).__name__}: a range of {limits.lowest:g} to {limits.highest:g} mm and "
                f"rates of {limits.slowest:g} to {limits.fastest:g} mm/s are not valid; open the "
                "hand, or set lowest_mm, highest_mm and fastest_mm_s"
            )

    def state(self) -> GripperState:
        """Read width, movement and, if the object has it, current."""
        width_mm, now_s = self._read_width(), self._clock.now_s()
        if abs(width_mm - self._last_mm) > _MOVED_MM:
            self._last_mm, self._moved_s = width_mm, now_s
        return GripperState(
            time_s=now_s,
            width_mm=width_mm,
            current_ma=self._ask("current_ma", math.nan),
            moving=bool(self._ask("is_moving", now_s - self._moved_s < _REST_S)),
        )

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Start a movement within the limits; return the command as sent."""
        sent = self.limits.clamp(wanted)
        self._moved_s = self._clock.now_s()
        self._call("move", sent.target, sent.rate)
        return sent

    def stop(self) -> None:
        """Stop in place."""
        self._call("stop")

    def release(self) -> None:
        """Open fully."""
        self.command(GripperCommand(target=self.limits.highest, rate=self.limits.fastest))

    def close(self) -> None:
        """Close the object, if it has a `close`."""
        if _has(self._hand, "close"):
            self._call("close")

    def _stated(self, name: str, default: float) -> float:
        return float(getattr(self._hand, name, default))

    def _read_width(self) -> float:
        width_mm = self._ask("width_mm", math.nan)
        if not math.isfinite(width_mm):
            raise DeviceError(
                f"{type(self._hand).__name__}: width_mm is {width_mm}; check its cable and supply"
            )
        return width_mm

    def _ask(self, name: str, default: float) -> float:
        """Return the value of an attribute, or of a method without arguments."""
        try:
            value = getattr(self._hand, name, default)
            value = value() if callable(value) else value
            return float(value)
        except PalpateError:
            raise
        except Exception as error:
            raise self._explain(name, error) from error

    def _call(self, name: str, *arguments: float) -> None:
        try:
            getattr(self._hand, name)(*arguments)
        except PalpateError:
            raise
        except Exception as error:
            raise self._explain(name, error) from error

    def _explain(self, name: str, error: Exception) -> DeviceError:
        return DeviceError(f"{type(self._hand).__name__}.{name}: {type(error).__name__}: {error}")


def _has(hand: object, name: str) -> bool:
    """Return whether an object has an attribute, even if reading it fails."""
    try:
        return hasattr(hand, name)
    except Exception:
        return True
