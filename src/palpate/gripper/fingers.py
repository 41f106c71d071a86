"""Finger opening from servo angle and back: a crank with sliders, or a hinge."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Grid of points for the slope of a travel, which has one flat maximum.
_LOOKS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class CrankFingers:
    """A horn on the servo moves each finger along a rail through an arm.

    With theta the horn's angle from the middle of its travel, a finger is at
    horn sin(theta) + sqrt(arm**2 - horn**2 cos(theta)**2) from the servo's axis, and the opening is
    twice that plus the offset. The default is the WidowX 250s.

    Source: Interbotix X-series arms, gripper settings of wx250s: horn 14 mm, arm 24 mm.

    >>> fingers = CrankFingers()
    >>> round(fingers.width_mm(0.0), 2), round(fingers.angle_rad(38.99), 3)
    (38.99, 0.0)
    """

    #: Radius of the horn, and length of the arms.
    horn_mm: float = 14.0
    arm_mm: float = 24.0
    #: Opening between the pads minus that between the carriages: negative with pads on. Measure it
    #: once; an error of it is taken out again by the compliance calibration.
    offset_mm: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.horn_mm < self.arm_mm:
            raise ValueError(
                f"the horn ({self.horn_mm:g} mm) must be shorter than the arm ({self.arm_mm:g} mm)"
            )

    @property
    def reach_mm(self) -> tuple[float, float]:
        """Smallest and largest opening that the mechanism has."""
        middle = 2 * self.arm_mm + self.offset_mm
        return middle - 2 * self.horn_mm, middle + 2 * self.horn_mm

    def width_mm(self, angle_rad: float) -> float:
        """Return the opening at an angle of the horn."""
        along = self.horn_mm * math.sin(angle_rad)
        across = self.horn_mm * math.cos(angle_rad)
        return 2 * (along + math.sqrt(self.arm_mm**2 - across**2)) + self.offset_mm

    def angle_rad(self, width_mm: float) -> float:
        """Return the angle of the horn at an opening.

        Raises `ValueError` if the mechanism can't reach it.
        """
        half = (width_mm - self.offset_mm) / 2
        sine = math.inf
        if half > 0:
            sine = (self.horn_mm**2 + half**2 - self.arm_mm**2) / (2 * self.horn_mm * half)
        if abs(sine) > 1:
            low, high = self.reach_mm
            raise ValueError(f"{width_mm:g} mm is outside the fingers' {low:g} to {high:g} mm")
        return math.asin(sine)

    def steepest_mm_per_rad(self, from_mm: float, to_mm: float) -> float:
        """Return the largest change of opening per radian on a way."""
        first, last = self.angle_rad(from_mm), self.angle_rad(to_mm)
        looks = (first + (last - first) * i / (_LOOKS - 1) for i in range(_LOOKS))
        return max(map(self._mm_per_rad, looks))

    def _mm_per_rad(self, angle_rad: float) -> float:
        along, across = self.horn_mm * math.sin(angle_rad), self.horn_mm * math.cos(angle_rad)
        return 2 * (across + along * across / math.sqrt(self.arm_mm**2 - across**2))


@dataclass(frozen=True, slots=True, kw_only=True)
class HingedJaw:
    """A jaw on the servo's horn.

    The opening is the chord between the middles of the two pads.

    >>> jaw = HingedJaw(jaw_mm=70.0)
    >>> round(jaw.width_mm(1.0), 2), round(jaw.angle_rad(67.12), 3)
    (67.12, 1.0)
    """

    #: From the servo's axis to the middle of the pad, mm.
    jaw_mm: float

    @property
    def reach_mm(self) -> tuple[float, float]:
        """Smallest and largest opening: closed, and half a turn open."""
        return 0.0, 2 * self.jaw_mm

    def width_mm(self, angle_rad: float) -> float:
        """Return the opening at an angle from closed."""
        return 2 * self.jaw_mm * math.sin(angle_rad / 2)

    def angle_rad(self, width_mm: float) -> float:
        """Return the angle from closed at an opening.

        Raises `ValueError` if the jaw can't reach it.
        """
        low, high = self.reach_mm
        if not low <= width_mm <= high:
            raise ValueError(f"{width_mm:g} mm is outside the jaw's {low:g} to {high:g} mm")
        return 2 * math.asin(width_mm / (2 * self.jaw_mm))

    def steepest_mm_per_rad(self, from_mm: float, to_mm: float) -> float:
        """Return the largest change of opening per radian on a way: at its narrower end."""
        return self.jaw_mm * math.cos(self.angle_rad(min(from_mm, to_mm)) / 2)
