"""A twin apple: not quite round, not equally firm all around, and bruised on one cheek or not.

Its outline across the equator is given by the support function of a convex body (distance from the
axis to the tangent in a direction t),

    p(t) = R (1 + oval cos 2(t - t2) + lobes cos 5(t - t5)),

an oval with the five lobes of an apple. A flat finger in direction t touches p'(t) off the axis
of closing, on a radius of curvature p + p''; two opposite fingers are p(t) + p(t + 180) apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.ranges import log_uniform, uniform
from palpate_studies.apple_faces import Face, Faces, Patch, first_touch
from palpate_studies.fruit_ranges import APPLES, AppleRanges, BruiseRanges

#: Beyond this distance from a bruise no contact with a finger reaches it, mm.
_CONTACT_MM = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bruise:
    """A bruise on an apple's cheek."""

    #: Where its middle lies: around the stem's axis, and above the equator along the surface.
    angle_deg: float
    height_mm: float
    #: Reach on the surface and depth.
    diameter_mm: float
    depth_mm: float
    #: Modulus of its flesh over that of sound flesh.
    softness: float
    #: By how much its middle lies below the round surface.
    dent_mm: float

    @property
    def area_cm2(self) -> float:
        """Area on the surface: what grades limit."""
        return math.pi * (self.diameter_mm / 20.0) ** 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Apple:
    """One apple.

    Examples
    --------
    >>> apple = draw_apple(np.random.default_rng(1), bruises=None)
    >>> 58 < apple.facing(0.0).size_mm < 72
    True
    """

    #: A round, sound fruit of its mean size and firmness.
    flesh: TwinObject
    #: Departures from round as shares of the radius, and where they are largest.
    oval: float
    lobes: float
    oval_deg: float
    lobes_deg: float
    #: By how much one side is firmer than the mean, as a share, and which.
    firmer: float
    firmer_deg: float
    #: By how much the place that a finger touches first goes up and down around the fruit.
    leaning_mm: float
    leaning_deg: float
    #: None if sound.
    bruise: Bruise | None = None

    @property
    def radius_mm(self) -> float:
        """Mean radius."""
        return self.flesh.size_mm / 2.0

    def facing(self, angle_deg: float) -> TwinObject:
        """Return the apple as two fingers meet it, the first at this angle, the second opposite."""
        sides = (self._face(angle_deg, across=1.0), self._face(angle_deg + 180.0, across=-1.0))
        faces = Faces(faces=sides, fruit_mm=self.flesh.size_mm)
        apart_mm = self._support(angle_deg)[0] + self._support(angle_deg + 180.0)[0]
        return replace(
            self.flesh,
            size_mm=apart_mm - sum(first_touch(side)[0] for side in sides),
            force_at_1mm_n=self.flesh.force_at_1mm_n * faces.stiffness,
            faces=faces,
        )

    def _support(self, angle_deg: float) -> tuple[float, float, float]:
        """Return p, p' and p + p'' in a direction, mm."""
        two, five = np.deg2rad([2 * (angle_deg - self.oval_deg), 5 * (angle_deg - self.lobes_deg)])
        oval, lobes = self.oval * self.radius_mm, self.lobes * self.radius_mm
        return (
            self.radius_mm + oval * math.cos(two) + lobes * math.cos(five),
            -2 * oval * math.sin(two) - 5 * lobes * math.sin(five),
            self.radius_mm - 3 * oval * math.cos(two) - 24 * lobes * math.cos(five),
        )

    def _face(self, angle_deg: float, *, across: float) -> Face:
        """Return one side; `across` is the sign of the fruit's angle along the fingers' columns."""
        _, beside_mm, curvature_mm = self._support(angle_deg)
        above_mm = self.leaning_mm * math.cos(math.radians(angle_deg - self.leaning_deg))
        towards = math.cos(math.radians(angle_deg - self.firmer_deg))
        face = Face(
            curvature_mm=2.0 * curvature_mm,
            firmness=math.exp(self.firmer * towards),
            contact_mm=(above_mm, across * beside_mm),
        )
        if self.bruise is None:
            return face
        around = math.remainder(self.bruise.angle_deg - angle_deg, 360.0)
        patch = Patch(
            along_mm=self.bruise.height_mm - above_mm,
            across_mm=across * (math.radians(around) * self.radius_mm - beside_mm),
            radius_mm=self.bruise.diameter_mm / 2.0,
            depth_mm=self.bruise.depth_mm,
            softness=self.bruise.softness,
            dent_mm=self.bruise.dent_mm,
        )
        far = math.hypot(patch.along_mm, patch.across_mm) > patch.radius_mm + _CONTACT_MM
        return face if far else replace(face, patch=patch)


def draw_apple(
    rng: np.random.Generator, *, bruises: BruiseRanges | None, apples: AppleRanges = APPLES
) -> Apple:
    """Draw an apple, bruised if there is something to draw the bruise from.

    Parameters
    ----------
    rng : Generator
        Source of chance.
    bruises : BruiseRanges or None
        Ranges of its bruise (`palpate_studies.fruit_ranges`); None for a sound one.
    apples : AppleRanges
        Ranges of the fruit.
    """
    flesh = replace(
        draw_object(rng, "apple"),
        size_mm=uniform(rng, apples.diameter_mm),
        force_at_1mm_n=log_uniform(rng, apples.force_at_1mm_n_log),
    )
    apple = Apple(
        flesh=flesh,
        oval=uniform(rng, apples.oval),
        lobes=uniform(rng, apples.lobes),
        oval_deg=uniform(rng, (0.0, 360.0)),
        lobes_deg=uniform(rng, (0.0, 360.0)),
        firmer=uniform(rng, apples.firmer),
        firmer_deg=uniform(rng, (0.0, 360.0)),
        leaning_mm=uniform(rng, apples.leaning_mm),
        leaning_deg=uniform(rng, (0.0, 360.0)),
    )
    return apple if bruises is None else replace(apple, bruise=draw_bruise(rng, bruises, apple))


def draw_bruise(rng: np.random.Generator, ranges: BruiseRanges, apple: Apple) -> Bruise:
    """Draw a bruise for an apple."""
    diameter_mm = log_uniform(rng, ranges.diameter_mm_log)
    # What a plane takes off a sphere of the apple's size when the contact is as wide as the bruise.
    flattened_mm = diameter_mm**2 / (8.0 * apple.radius_mm)
    return Bruise(
        angle_deg=uniform(rng, (0.0, 360.0)),
        height_mm=uniform(rng, ranges.height_mm),
        diameter_mm=diameter_mm,
        depth_mm=diameter_mm * uniform(rng, ranges.depth_over_diameter),
        softness=uniform(rng, ranges.softness),
        dent_mm=flattened_mm * uniform(rng, ranges.dent_share),
    )
