"""A simulated apple, not quite round or uniformly firm, with or without one bruise.

The outline across the equator is defined by the support function of a convex body (distance from
the axis to the tangent in a direction t),

    p(t) = R (1 + oval cos 2(t - t2) + lobes cos 5(t - t5)),

an oval with the five lobes of an apple. A flat finger in direction t touches p'(t) off the axis
of closing, with the radius of curvature p + p''; two opposite fingers are p(t) + p(t + 180) apart.

A bruise under a finger is softer and flatter and redistributes the load. A face is a bed of springs
under a round surface (Winkler) whose contact has the radius of Hertz, a (a**2 = D d / 2 for a side
that deflects by d, with the diameter of curvature D). The pressure at a place with the gap g to the
undeformed surface is proportional to

    c * max(1 - D g / a**2, 0),    g = r**2 / D + dent - smallest gap

The springs of the bruise are softer: for flesh of depth h and modulus E' on sound flesh of modulus
E, strained down to a depth of about a, 1/c = 1 + (h / a) (E / E' - 1). Depth and dent decrease from
the middle of the bruise to its rim like a paraboloid. Pad and sheet spread each element of the
contact over 8 mm.

Both fingers have the same force. The load that soft flesh does not carry is carried by its
surroundings, on the pixels or next to them: a bruise moves load rather than removing it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.ranges import draw_log_uniform, draw_uniform
from palpate_studies.fruit_ranges import APPLES, AppleRanges, BruiseRanges

if TYPE_CHECKING:
    from palpate.twin.placement import PixelGrid

#: Grid points in a line across a contact, and range of the grid in radii of a sound contact: a flat
#: contact with a dent of 0.8 of the flattening is 2.2 times as wide.
_PLACES, _RANGE_RADII = 21, 2.4
#: Spread of a load by pad and sheet, mm, as in `mechanics.pixel_fractions` for the paper's pixels.
#: It also limits the resolution of finer pixels.
_SPREAD_MM = 8.0
#: Half of the pads' deflection in the middle of their range, by which they conform to a surface.
_PAD_MM = 0.15
#: Deflection of a side at which stiffnesses are compared, mm: the middle of the range of grasps.
_USUAL_SIDE_MM = 0.5
#: Resolution of the deflections with a contact of their own, mm.
_STEP_MM = 0.005
#: Margin around a bruise in the search for the first touch, mm.
_SEARCH_MARGIN_MM = 10.0
#: Distance from a bruise beyond which no contact with a finger includes it, mm.
_CONTACT_MM = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Patch:
    """A bruise relative to the contact of one finger."""

    #: Position of the middle relative to the contact point, on the surface.
    along_mm: float
    across_mm: float
    #: Radius on the surface, and depth at the middle.
    radius_mm: float
    depth_mm: float
    #: Modulus of bruised flesh over that of sound flesh.
    softness: float
    #: Depth of the middle below the round surface.
    dent_mm: float

    def profile(self, along_mm: FloatArray, across_mm: FloatArray) -> FloatArray:
        """Return the relative depth: 1 in the middle, 0 at the rim and outside."""
        off_mm2 = (along_mm - self.along_mm) ** 2 + (across_mm - self.across_mm) ** 2
        return np.maximum(1.0 - off_mm2 / self.radius_mm**2, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Face:
    """The side of a fruit under one finger."""

    #: Local diameter of curvature.
    curvature_mm: float
    #: Local stiffness of the flesh relative to the fruit's mean.
    firmness: float
    #: First contact of a sound fruit relative to the axis of closing, along and across.
    contact_mm: tuple[float, float]
    #: A bruise near the contact.
    patch: Patch | None = None

    def stiffness(self, fruit_mm: float) -> float:
        """Return the stiffness of this side relative to a round, sound fruit of its size."""
        sound = find_contact(replace(self, patch=None), _USUAL_SIDE_MM).pressure.sum()
        # Hertz: force is proportional to the root of the radius of curvature.
        curved = math.sqrt(self.curvature_mm / fruit_mm)
        fraction = find_contact(self, _USUAL_SIDE_MM).pressure.sum() / sound
        return float(self.firmness * curved * fraction)


@dataclass(frozen=True, slots=True)
class FaceContact:
    """Pressure on one face, on a grid relative to the contact point.

    `pressure` has shape (along, across) and is 1 in the middle of a sound contact.
    """

    along_mm: FloatArray
    across_mm: FloatArray
    pressure: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Faces:
    """Both sides of a fruit between two fingers; `fruit_mm` is its mean diameter."""

    faces: tuple[Face, Face]
    fruit_mm: float

    @property
    def stiffness(self) -> float:
        """Stiffness relative to a round, sound fruit."""
        return float((sum(_side_deflections(self)) / 2.0) ** -1.5)

    def pixel_fractions(
        self, deformation_mm: float, *, grid: PixelGrid, off_centre_mm: tuple[float, float]
    ) -> FloatArray:
        """Return each pixel's fraction of its finger's force, shape (pixels,).

        The fractions of a sound face sum to 1, as for all objects; those of a bruised face may not.
        """
        fractions, deflections = np.zeros(grid.finger.size), _side_deflections(self)
        for finger, face in enumerate(self.faces):
            mine = grid.finger == finger
            side_mm = max(deformation_mm, 0.0) * deflections[finger] / sum(deflections)
            # Rounded, so that the many time steps of a hold use one cached contact.
            side_mm = _STEP_MM * round(side_mm / _STEP_MM)
            middle_mm = (
                grid.along_mm[mine] - off_centre_mm[0] - face.contact_mm[0],
                grid.across_mm[mine] - off_centre_mm[1] - face.contact_mm[1],
            )
            caught = _fraction_caught(
                find_contact(face, side_mm), middle_mm, pitch_mm=grid.pitch_mm
            )
            if_sound = caught
            if face.patch is not None:
                sound = find_contact(replace(face, patch=None), side_mm)
                if_sound = _fraction_caught(sound, middle_mm, pitch_mm=grid.pitch_mm)
            fractions[mine] = caught / max(if_sound.sum(), 1e-12)
        return fractions


@lru_cache(maxsize=512)
def find_contact(face: Face, side_mm: float) -> FaceContact:
    """Return the contact of a face that deflects by `side_mm`."""
    radius_mm = math.sqrt(0.5 * face.curvature_mm * (side_mm + _PAD_MM))
    line = np.linspace(-_RANGE_RADII * radius_mm, _RANGE_RADII * radius_mm, _PLACES)
    if face.patch is None:
        return FaceContact(
            line, line, np.maximum(1.0 - _distance_squared(line, line) / radius_mm**2, 0.0)
        )
    least_mm, *touched = find_first_touch(face)
    along, across = line + touched[0], line + touched[1]
    profile = face.patch.profile(along[:, None], across)
    gap_mm2 = _distance_squared(along, across) + face.curvature_mm * (
        face.patch.dent_mm * profile - least_mm
    )
    deep = np.minimum(face.patch.depth_mm * profile / radius_mm, 1.0)
    compliance = 1.0 + deep * (1.0 / face.patch.softness - 1.0)
    return FaceContact(along, across, np.maximum(1.0 - gap_mm2 / radius_mm**2, 0.0) / compliance)


@lru_cache(maxsize=256)
def find_first_touch(face: Face) -> tuple[float, float, float]:
    """Return the gap at the first touch, and the position of this touch, mm."""
    if face.patch is None:
        return 0.0, 0.0, 0.0
    range_mm = face.patch.radius_mm + _SEARCH_MARGIN_MM
    line = np.linspace(-range_mm, range_mm, 61)
    gap_mm = _distance_squared(line, line) / face.curvature_mm
    gap_mm = gap_mm + face.patch.dent_mm * face.patch.profile(line[:, None], line)
    along, across = np.unravel_index(np.argmin(gap_mm), gap_mm.shape)
    return float(gap_mm[along, across]), float(line[along]), float(line[across])


def _distance_squared(along_mm: FloatArray, across_mm: FloatArray) -> FloatArray:
    """Return the squared distances of grid points from the contact point."""
    return np.asarray(along_mm[:, None] ** 2 + across_mm**2)


def _fraction_caught(
    found: FaceContact, middle_mm: tuple[FloatArray, FloatArray], *, pitch_mm: float
) -> FloatArray:
    """Return the fraction of a contact's force on each pixel, shape (pixels,).

    Each element is spread with the density 3/4 (1 - t**2) over |t| < 1 in both directions; pixels
    are one pitch wide.
    """
    along, across = (
        _overlap_fraction(middle[:, None] - place, pitch_mm=pitch_mm)
        for middle, place in zip(middle_mm, (found.along_mm, found.across_mm), strict=True)
    )
    return np.asarray(np.sum(along @ found.pressure * across, axis=1) / found.pressure.sum())


def _overlap_fraction(apart_mm: FloatArray, *, pitch_mm: float) -> FloatArray:
    """Return the fraction of a spread load on a pixel at this distance."""
    edges = apart_mm[..., None] + np.array([0.5, -0.5]) * pitch_mm
    t = np.clip(edges / _SPREAD_MM, -1.0, 1.0)
    below = 0.25 * (3.0 * t - t**3)
    return np.asarray(below[..., 0] - below[..., 1])


@lru_cache(maxsize=256)
def _side_deflections(faces: Faces) -> tuple[float, float]:
    """Return the deformation of each side under one force, F = K d ** 1.5."""
    one, other = (face.stiffness(faces.fruit_mm) ** (-2 / 3) for face in faces.faces)
    return one, other


@dataclass(frozen=True, slots=True, kw_only=True)
class Bruise:
    """A bruise on an apple's cheek."""

    #: Position of the middle: angle around the stem, and height above the equator on the surface.
    angle_deg: float
    height_mm: float
    #: Diameter on the surface, and depth.
    diameter_mm: float
    depth_mm: float
    #: Modulus of its flesh over that of sound flesh.
    softness: float
    #: Depth of the middle below the round surface.
    dent_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Apple:
    """One apple.

    Examples
    --------
    >>> apple = draw_apple(np.random.default_rng(1), bruises=None)
    >>> 58 < apple.facing(0.0).size_mm < 72
    True
    """

    #: A round, sound fruit of the same mean size and firmness.
    flesh: TwinObject
    #: Ovality and lobes as fractions of the radius, and the angles of their maxima.
    oval: float
    lobes: float
    oval_deg: float
    lobes_deg: float
    #: Relative excess firmness of one side, and the angle of this side.
    firmer: float
    firmer_deg: float
    #: Amplitude of the height of the first touch around the fruit, and the angle of its maximum.
    leaning_mm: float
    leaning_deg: float
    #: None for a sound apple.
    bruise: Bruise | None = None

    @property
    def radius_mm(self) -> float:
        """Mean radius."""
        return self.flesh.size_mm / 2.0

    def facing(self, angle_deg: float) -> TwinObject:
        """Return the apple between two fingers at this angle and opposite."""
        sides = (self._face(angle_deg, across=1.0), self._face(angle_deg + 180.0, across=-1.0))
        faces = Faces(faces=sides, fruit_mm=self.flesh.size_mm)
        apart_mm = self._support(angle_deg)[0] + self._support(angle_deg + 180.0)[0]
        return replace(
            self.flesh,
            size_mm=apart_mm - sum(find_first_touch(side)[0] for side in sides),
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
        """Return one side; `across` is the sign of the angle along the finger's columns."""
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
    """Draw an apple, with a bruise if its ranges are given.

    Parameters
    ----------
    rng : Generator
        Random number generator.
    bruises : BruiseRanges or None
        Ranges of the bruise (`palpate_studies.fruit_ranges`); None for a sound apple.
    apples : AppleRanges
        Ranges of the fruit.
    """
    flesh = replace(
        draw_object(rng, "apple"),
        size_mm=draw_uniform(rng, apples.diameter_mm),
        force_at_1mm_n=draw_log_uniform(rng, apples.force_at_1mm_n_log),
    )
    apple = Apple(
        flesh=flesh,
        oval=draw_uniform(rng, apples.oval),
        lobes=draw_uniform(rng, apples.lobes),
        oval_deg=draw_uniform(rng, (0.0, 360.0)),
        lobes_deg=draw_uniform(rng, (0.0, 360.0)),
        firmer=draw_uniform(rng, apples.firmer),
        firmer_deg=draw_uniform(rng, (0.0, 360.0)),
        leaning_mm=draw_uniform(rng, apples.leaning_mm),
        leaning_deg=draw_uniform(rng, (0.0, 360.0)),
    )
    return apple if bruises is None else replace(apple, bruise=draw_bruise(rng, bruises, apple))


def draw_bruise(rng: np.random.Generator, ranges: BruiseRanges, apple: Apple) -> Bruise:
    """Draw a bruise for an apple."""
    diameter_mm = draw_log_uniform(rng, ranges.diameter_mm_log)
    # Flattening of a sphere of the apple's size with a plane contact as wide as the bruise.
    flattened_mm = diameter_mm**2 / (8.0 * apple.radius_mm)
    return Bruise(
        angle_deg=draw_uniform(rng, (0.0, 360.0)),
        height_mm=draw_uniform(rng, ranges.height_mm),
        diameter_mm=diameter_mm,
        depth_mm=diameter_mm * draw_uniform(rng, ranges.depth_over_diameter),
        softness=draw_uniform(rng, ranges.softness),
        dent_mm=flattened_mm * draw_uniform(rng, ranges.dent_fraction),
    )
