"""Friction of both fingers, and sliding of an object pulled along the pads."""

from __future__ import annotations

from dataclasses import dataclass

#: Standard gravity, N per gram.
N_PER_G = 9.80665e-3
#: Ratio of sliding to static friction (plausible for rubber-like tape, not measured).
_SLIDING_FRACTION = 0.8
#: Sliding distance, mm, after which the object has left the pads: half the length of a pad.
PAD_MM = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Slide:
    """Sliding of an object along the pads."""

    #: Distance since the start of the pull.
    slid_mm: float = 0.0
    #: 0 while static friction holds the object.
    speed_mm_per_s: float = 0.0

    @property
    def is_off_pads(self) -> bool:
        """Whether the object has left the pads."""
        return self.slid_mm >= PAD_MM

    def advance(
        self, step_s: float, *, pull_n: float, grip_n: float, friction: float, mass_g: float
    ) -> Slide:
        """Return the sliding state after one time step.

        `step_s`: short compared with the time to slide off the pads.
        `pull_n`: pull along the pads, including the weight.
        `grip_n`: normal force of each finger.
        `friction`: coefficient between pads and object; both fingers contribute.
        `mass_g`: mass of the object.

        >>> held = Slide().advance(0.1, pull_n=1.0, grip_n=1.0, friction=0.6, mass_g=100.0)
        >>> slipping = Slide().advance(0.1, pull_n=1.0, grip_n=0.5, friction=0.6, mass_g=100.0)
        >>> held.speed_mm_per_s, round(slipping.speed_mm_per_s)
        (0.0, 520)
        """
        static_n = 2.0 * friction * grip_n
        if self.speed_mm_per_s == 0 and pull_n <= static_n:
            return self
        acceleration_mm_per_s2 = 1e6 * (pull_n - static_n * _SLIDING_FRACTION) / mass_g
        speed = max(self.speed_mm_per_s + acceleration_mm_per_s2 * step_s, 0.0)
        distance_mm = 0.5 * (self.speed_mm_per_s + speed) * step_s
        return Slide(slid_mm=self.slid_mm + distance_mm, speed_mm_per_s=speed)


#: No sliding yet.
AT_REST = Slide()
