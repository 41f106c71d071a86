"""Friction of both fingers: load along the pads, partial slip, and sliding of the object."""

from __future__ import annotations

from dataclasses import dataclass

#: Standard gravity, N per gram.
N_PER_G = 9.80665e-3
#: Ratio of sliding to static friction (plausible for rubber-like tape, not measured).
_SLIDING_FRACTION = 0.8
#: Sliding distance, mm, after which the object has left the pads: half the length of a pad.
PAD_MM = 10.0
#: Poisson's ratio of the pads; rubber is nearly incompressible.
_POISSON_RATIO = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Pull:
    """Load along the pads: the weight, and a further load that may rise and yield.

    P(t, s) = max(weight + more * min((t - start) / rise, 1) - stiffness * s, 0), with the sliding
    distance s. Without stiffness the load is dead: inertia of a swing, or a growing weight. With
    stiffness something elastic pulls, such as a stem or another hand, which yields as the object
    slides.

    >>> stem = Pull(weight_n=1.0, more_n=4.0, start_s=2.0, rise_s=1.0, n_per_mm=0.5)
    >>> [stem.force_n(time_s, slid_mm=0.0) for time_s in (2.0, 2.5, 4.0)]
    [1.0, 3.0, 5.0]
    >>> stem.force_n(4.0, slid_mm=2.0)
    4.0
    """

    weight_n: float
    more_n: float = 0.0
    start_s: float = 0.0
    rise_s: float = 0.0
    n_per_mm: float = 0.0

    def force_n(self, time_s: float, *, slid_mm: float) -> float:
        """Return the load at a time, newtons, after sliding by a distance."""
        rising = self.is_rising(time_s)
        fraction = max(time_s - self.start_s, 0.0) / self.rise_s if rising else 1.0
        return max(self.weight_n + self.more_n * fraction - self.n_per_mm * slid_mm, 0.0)

    def is_rising(self, time_s: float) -> bool:
        """Return whether the load has not yet reached its end value."""
        return time_s < self.start_s + self.rise_s


def shear_mm(pull_n: float, *, limit_n: float, friction: float, pad_mm: float) -> float:
    """Return how far the pads' surface shifts before the object slides as a whole, mm.

    Partial slip of a round contact (Mindlin 1949; Johnson, Contact Mechanics, section 7.2): a ring
    at the edge slips first, and the shift is

        u = (2 - nu) / (2 (1 - nu)) * mu * d * (1 - (1 - P / P_max) ** (2 / 3))

    with the indentation d of one pad and the friction limit P_max. The object's own shear is left
    out, so that the shift is not overestimated.

    >>> [round(shear_mm(n, limit_n=2.0, friction=0.6, pad_mm=0.1), 3) for n in (0.0, 1.0, 2.0)]
    [0.0, 0.033, 0.09]
    """
    if limit_n <= 0:
        return 0.0
    free = max(1.0 - pull_n / limit_n, 0.0)
    ratio = (2.0 - _POISSON_RATIO) / (2.0 * (1.0 - _POISSON_RATIO))
    return float(ratio * friction * pad_mm * (1.0 - free ** (2.0 / 3.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Slide:
    """Sliding of an object along the pads."""

    #: Distance since the start of the pull.
    slid_mm: float = 0.0
    #: 0 while static friction holds the object.
    speed_mm_per_s: float = 0.0
    #: Largest shift by partial slip so far; the pads do not spring back under load.
    sheared_mm: float = 0.0

    @property
    def is_off_pads(self) -> bool:
        """Whether the object has left the pads."""
        return self.slid_mm >= PAD_MM

    @property
    def shift_mm(self) -> float:
        """Shift of the contact along the pads: partial slip and sliding."""
        return self.slid_mm + self.sheared_mm

    def advance(
        self,
        step_s: float,
        *,
        pull_n: float,
        grip_n: float,
        friction: float,
        mass_g: float,
        pad_mm: float = 0.0,
    ) -> Slide:
        """Return the sliding state after one time step.

        `step_s`: short compared with the time to slide off the pads.
        `pull_n`: pull along the pads, including the weight.
        `grip_n`: normal force of each finger.
        `friction`: coefficient between pads and object; both fingers contribute.
        `mass_g`: mass of the object.
        `pad_mm`: indentation of one pad, for the partial slip.

        >>> held = Slide().advance(0.1, pull_n=1.0, grip_n=1.0, friction=0.6, mass_g=100.0)
        >>> slipping = Slide().advance(0.1, pull_n=1.0, grip_n=0.5, friction=0.6, mass_g=100.0)
        >>> held.speed_mm_per_s, round(slipping.speed_mm_per_s)
        (0.0, 520)
        """
        static_n = 2.0 * friction * grip_n
        shear = shear_mm(pull_n, limit_n=static_n, friction=friction, pad_mm=pad_mm)
        sheared_mm = max(self.sheared_mm, shear)
        if self.speed_mm_per_s == 0 and pull_n <= static_n:
            return Slide(slid_mm=self.slid_mm, sheared_mm=sheared_mm)
        acceleration_mm_per_s2 = 1e6 * (pull_n - static_n * _SLIDING_FRACTION) / mass_g
        speed = max(self.speed_mm_per_s + acceleration_mm_per_s2 * step_s, 0.0)
        distance_mm = 0.5 * (self.speed_mm_per_s + speed) * step_s
        return Slide(
            slid_mm=self.slid_mm + distance_mm, speed_mm_per_s=speed, sheared_mm=sheared_mm
        )


#: No sliding yet.
AT_REST = Slide()
