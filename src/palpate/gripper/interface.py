"""The interface of a gripper, whether it is driven by width or by pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperLimits:
    """The range of a gripper's one degree of freedom.

    Attributes
    ----------
    drive : {"width", "pressure"}
        What a command sets: the opening in mm, or the pressure in kPa.
    lowest, highest : float
        Range of the command, mm or kPa according to `drive`.
    fastest : float
        Largest rate of the command, mm/s or kPa/s.
    """

    drive: Literal["width", "pressure"]
    lowest: float
    highest: float
    fastest: float

    @property
    def span(self) -> float:
        """Closure of the closed hand: how far it can close, mm or kPa."""
        return self.highest - self.lowest

    def reading_of(self, state: GripperState) -> float:
        """Return what the gripper reports of the quantity that commands set, mm or kPa."""
        return state.width_mm if self.drive == "width" else state.pressure_kpa

    def closure(self, state: GripperState) -> float:
        """Return how far the hand is closed: 0 is open, whichever way its drive counts.

        Examples
        --------
        >>> soft = GripperLimits(drive="pressure", lowest=0.0, highest=50.0, fastest=60.0)
        >>> soft.closure(GripperState(time_s=0.0, pressure_kpa=12.0)), soft.target(12.0)
        (12.0, 12.0)
        >>> rigid = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
        >>> rigid.closure(GripperState(time_s=0.0, width_mm=70.0)), rigid.target(4.0)
        (4.0, 70.0)
        """
        reported = self.reading_of(state)
        return self.highest - reported if self.drive == "width" else reported - self.lowest

    def target(self, closure: float) -> float:
        """Return the command's target for a closure."""
        return self.highest - closure if self.drive == "width" else self.lowest + closure

    def clamp(self, wanted: GripperCommand) -> GripperCommand:
        """Return a command with its target within the range and its rate within the limit.

        Examples
        --------
        >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
        >>> limits.clamp(GripperCommand(target=80.0, rate=90.0))
        GripperCommand(target=74.0, rate=60.0)
        """
        return GripperCommand(
            target=min(max(wanted.target, self.lowest), self.highest),
            rate=min(wanted.rate, self.fastest),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperState:
    """The gripper's reported state; NaN for what it can't sense."""

    time_s: float
    width_mm: float = math.nan
    pressure_kpa: float = math.nan
    current_ma: float = math.nan
    moving: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperCommand:
    """Target and rate of a movement: mm and mm/s, or kPa and kPa/s, by `drive`."""

    target: float
    rate: float


class Gripper(Protocol):
    """One gripper, opened and owned by the runner."""

    @property
    def limits(self) -> GripperLimits:
        """Range and drive of this gripper."""
        ...

    def state(self) -> GripperState:
        """Read the gripper's present state."""
        ...

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send a command, clamped to the limits; return what was really sent."""
        ...

    def stop(self) -> None:
        """Stop where it is. Always callable; a failure raises `DeviceError`."""
        ...

    def release(self) -> None:
        """Open fully (width) or vent (pressure)."""
        ...

    def close(self) -> None:
        """Close the device; calling it again does nothing."""
        ...
