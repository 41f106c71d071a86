"""The interface of a gripper, controlled by width or by pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

from palpate.clock import Clock

#: Interval between states while the gripper opens, seconds.
_POLL_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperLimits:
    """Range and largest rate of a gripper's one degree of freedom.

    Attributes
    ----------
    drive : {"width", "pressure"}
        The controlled quantity: opening in mm, or pressure in kPa.
    lowest, highest : float
        Range of the target, mm or kPa according to `drive`.
    fastest, slowest : float
        Largest and smallest rate, mm/s or kPa/s. A gripper that can't move as slowly as requested
        moves at its slowest rate.
    """

    drive: Literal["width", "pressure"]
    lowest: float
    highest: float
    fastest: float
    slowest: float = 0.0

    @property
    def span(self) -> float:
        """Full closing travel, mm or kPa."""
        return self.highest - self.lowest

    def drive_reading(self, state: GripperState) -> float:
        """Return the reported value of the controlled quantity, mm or kPa."""
        return state.width_mm if self.drive == "width" else state.pressure_kpa

    def closure(self, state: GripperState) -> float:
        """Return the closing travel, mm or kPa: 0 if fully open, for either drive.

        Examples
        --------
        >>> soft = GripperLimits(drive="pressure", lowest=0.0, highest=50.0, fastest=60.0)
        >>> soft.closure(GripperState(time_s=0.0, pressure_kpa=12.0)), soft.target(12.0)
        (12.0, 12.0)
        >>> rigid = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
        >>> rigid.closure(GripperState(time_s=0.0, width_mm=70.0)), rigid.target(4.0)
        (4.0, 70.0)
        """
        reported = self.drive_reading(state)
        return self.highest - reported if self.drive == "width" else reported - self.lowest

    def target(self, closure: float) -> float:
        """Return the target of a command for a closure."""
        return self.highest - closure if self.drive == "width" else self.lowest + closure

    def clamp(self, wanted: GripperCommand) -> GripperCommand:
        """Return the command with its target and rate limited.

        Examples
        --------
        >>> limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
        >>> limits.clamp(GripperCommand(target=80.0, rate=90.0))
        GripperCommand(target=74.0, rate=60.0)
        """
        return GripperCommand(
            target=min(max(wanted.target, self.lowest), self.highest),
            rate=min(max(wanted.rate, self.slowest), self.fastest),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperState:
    """The gripper's reported state; quantities without a sensor are NaN."""

    time_s: float
    width_mm: float = math.nan
    pressure_kpa: float = math.nan
    current_ma: float = math.nan
    moving: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperCommand:
    """Target and rate of a movement, in mm and mm/s or kPa and kPa/s."""

    target: float
    rate: float


class Gripper(Protocol):
    """A gripper with one degree of freedom."""

    @property
    def limits(self) -> GripperLimits:
        """Range and drive of this gripper."""
        ...

    def state(self) -> GripperState:
        """Read the gripper's present state."""
        ...

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send a command, clamped to the limits; return the command sent."""
        ...

    def stop(self) -> None:
        """Stop at the current position, in any state; a failure raises `DeviceError`."""
        ...

    def release(self) -> None:
        """Open fully (width) or vent (pressure)."""
        ...

    def close(self) -> None:
        """Close the device; calling it again does nothing."""
        ...


def open_fully(gripper: Gripper, *, clock: Clock) -> None:
    """Open a gripper, and wait until it no longer moves."""
    gripper.release()
    while gripper.state().moving:
        clock.sleep_s(_POLL_S)
