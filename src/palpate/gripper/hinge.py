"""From a servo's angle to the opening of a jaw that turns against a fixed one (SO-101)."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class HingedJaw:
    """A jaw on the servo's horn. The opening is the chord between the middles of the two pads.

    Examples
    --------
    >>> jaw = HingedJaw(jaw_mm=70.0)
    >>> round(jaw.width_mm(1.0), 2), round(jaw.angle_rad(67.12), 3)
    (67.12, 1.0)
    """

    #: From the servo's axis to the middle of the pad, mm.
    jaw_mm: float
    #: Opening at angle 0: 0 where the pads touch there.
    offset_mm: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.jaw_mm) and self.jaw_mm > 0):
            raise ValueError(f"jaw_mm must be positive, not {self.jaw_mm!r}")

    @property
    def reach_mm(self) -> tuple[float, float]:
        """Smallest and largest opening: closed, and half a turn open."""
        return self.offset_mm, self.offset_mm + 2 * self.jaw_mm

    def width_mm(self, angle_rad: float) -> float:
        """Return the opening at an angle from closed."""
        return self.offset_mm + 2 * self.jaw_mm * math.sin(angle_rad / 2)

    def angle_rad(self, width_mm: float) -> float:
        """Return the angle from closed at an opening.

        Raises
        ------
        ValueError
            If the jaw can't reach it.
        """
        low, high = self.reach_mm
        if not low <= width_mm <= high:
            raise ValueError(f"{width_mm:g} mm is outside the jaw's {low:g} to {high:g} mm")
        return 2 * math.asin((width_mm - self.offset_mm) / (2 * self.jaw_mm))

    def steepest_mm_per_rad(self, from_mm: float, to_mm: float) -> float:
        """Return the largest change of opening per radian on a way: at its narrower end."""
        return self.jaw_mm * math.cos(self.angle_rad(min(from_mm, to_mm)) / 2)
