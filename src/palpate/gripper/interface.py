"""What a gripper must offer, whether it is driven by width or by pressure."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperState:
    """What the gripper reports of itself; NaN for what it can't sense."""

    time_s: float
    width_mm: float = math.nan
    pressure_kpa: float = math.nan
    current_ma: float = math.nan
    moving: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperCommand:
    """Where to go and how fast: mm and mm/s, or kPa and kPa/s, as the gripper's `drive` says."""

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
        """Let go of the device; calling it again does nothing."""
        ...
