"""Conversion between servo angle and finger opening, for a slider-crank and a hinge."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.errors import InputError
from palpate.gripper.settings import check_number

#: Largest length of a hand for produce, and smallest jaw. Others are slips of the pen.
_MAX_MM, _MIN_JAW_MM = 300.0, 10.0
#: Number of sample points for the largest slope; the slope has one flat maximum.
_SLOPE_POINTS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class CrankFingers:
    """Fingers on rails, each moved by a servo horn through an arm.

    Let theta be the horn's angle from the middle of its travel. The distance of a finger from the
    servo's axis is horn sin(theta) + sqrt(arm**2 - horn**2 cos(theta)**2). The opening is twice
    this distance plus the offset. The default is the WidowX 250s.

    Source: Interbotix X-series arms, gripper settings of wx250s: horn 14 mm, arm 24 mm.

    >>> fingers = CrankFingers()
    >>> round(fingers.width_mm(0.0), 2), round(fingers.angle_rad(38.99), 3)
    (38.99, 0.0)
    """

    #: Radius of the horn, and length of the arms.
    horn_mm: float = 14.0
    arm_mm: float = 24.0
    #: Opening between the pads minus the opening between the carriages; negative with pads. Measure
    #: this offset once. The compliance calibration corrects an error.
    offset_mm: float = 0.0

    def __post_init__(self) -> None:
        check_number("offset_mm", self.offset_mm, low=-_MAX_MM, high=_MAX_MM, unit="mm")
        if not 0 < self.horn_mm < self.arm_mm:
            raise InputError(
                f"horn_mm {self.horn_mm:g}: must be above 0 and below arm_mm {self.arm_mm:g}"
            )
        check_number("arm_mm", self.arm_mm, low=0.0, high=_MAX_MM, unit="mm")

    @property
    def range_mm(self) -> tuple[float, float]:
        """Smallest and largest opening of the mechanism."""
        middle = 2 * self.arm_mm + self.offset_mm
        return middle - 2 * self.horn_mm, middle + 2 * self.horn_mm

    def width_mm(self, angle_rad: float) -> float:
        """Return the opening at an angle of the horn."""
        along = self.horn_mm * math.sin(angle_rad)
        across = self.horn_mm * math.cos(angle_rad)
        return 2 * (along + math.sqrt(self.arm_mm**2 - across**2)) + self.offset_mm

    def angle_rad(self, width_mm: float) -> float:
        """Return the angle of the horn at an opening.

        Raises `ValueError` if the opening is out of range.
        """
        half = (width_mm - self.offset_mm) / 2
        sine = math.inf
        if half > 0:
            sine = (self.horn_mm**2 + half**2 - self.arm_mm**2) / (2 * self.horn_mm * half)
        # Rounding can exceed 1 at both ends of the range.
        if abs(sine) > 1 + 1e-9:
            low, high = self.range_mm
            raise ValueError(
                f"{width_mm:g} mm is outside the fingers' range of {low:g} to {high:g} mm"
            )
        return math.asin(min(max(sine, -1.0), 1.0))

    def max_mm_per_rad(self, from_mm: float, to_mm: float) -> float:
        """Return the maximum slope between two openings, mm of opening per radian."""
        first, last = self.angle_rad(from_mm), self.angle_rad(to_mm)
        step = (last - first) / (_SLOPE_POINTS - 1)
        return max(self._mm_per_rad(first + step * i) for i in range(_SLOPE_POINTS))

    def _mm_per_rad(self, angle_rad: float) -> float:
        along, across = self.horn_mm * math.sin(angle_rad), self.horn_mm * math.cos(angle_rad)
        return 2 * (across + along * across / math.sqrt(self.arm_mm**2 - across**2))


@dataclass(frozen=True, slots=True, kw_only=True)
class HingedJaw:
    """A jaw on the servo's horn, opposite a fixed jaw.

    The opening is the chord between the middles of the two pads.

    >>> jaw = HingedJaw(jaw_mm=70.0)
    >>> round(jaw.width_mm(1.0), 2), round(jaw.angle_rad(67.12), 3)
    (67.12, 1.0)
    """

    #: Distance from the servo's axis to the middle of the pad.
    jaw_mm: float

    def __post_init__(self) -> None:
        check_number("jaw_mm", self.jaw_mm, low=_MIN_JAW_MM, high=_MAX_MM, unit="mm")

    @property
    def range_mm(self) -> tuple[float, float]:
        """Smallest and largest opening: closed, and half a turn open."""
        return 0.0, 2 * self.jaw_mm

    def width_mm(self, angle_rad: float) -> float:
        """Return the opening at an angle from the closed position."""
        return 2 * self.jaw_mm * math.sin(angle_rad / 2)

    def angle_rad(self, width_mm: float) -> float:
        """Return the angle from the closed position at an opening.

        Raises `ValueError` if the opening is out of range.
        """
        low, high = self.range_mm
        if not low <= width_mm <= high:
            raise ValueError(
                f"{width_mm:g} mm is outside the jaw's range of {low:g} to {high:g} mm"
            )
        return 2 * math.asin(width_mm / (2 * self.jaw_mm))

    def max_mm_per_rad(self, from_mm: float, to_mm: float) -> float:
        """Return the maximum slope, mm of opening per radian, which is at the narrower opening."""
        return self.jaw_mm * math.cos(self.angle_rad(min(from_mm, to_mm)) / 2)
