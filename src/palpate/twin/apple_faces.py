"""What a bruise changes where a finger presses: softer flesh, a dent, load that goes elsewhere.

A face is a bed of springs under a round surface (Winkler), as the contact of `pixel_shares` is: at
a reach a of the contact, the pressure at a place with gap g to the finger goes as

    c * max(1 - D g / a**2, 0),    g = r**2 / D + dent - least gap

with D the diameter of curvature there. In the bruise the springs are softer: flesh of depth h and
modulus E' on sound flesh of modulus E, strained down to about the reach a of the contact, gives way
as 1/c = 1 + (h / a) (E / E' - 1). Depth and dent fall from the middle of the bruise to its rim as a
paraboloid does.

Both fingers carry the same force, and what soft pixels don't carry their neighbours and the flesh
beyond the pixels do. So a bruise moves load more than it takes any away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from palpate.twin.mechanics import PixelGrid

FloatArray: TypeAlias = NDArray[np.float64]

#: Points per pixel and direction; how far from the contact its whole force is summed, in reaches.
_POINTS, _WHOLE = 5, 1.3
#: Indentation of one side, mm, at which stiffness is compared: the middle of what grasps use.
_USUAL_SIDE_MM = 0.5
#: How far beside a bruise the place of first touch is looked for, mm.
_BESIDE_MM = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Patch:
    """A bruise as one finger meets it.

    Attributes
    ----------
    along_mm, across_mm : float
        Where its middle lies from the contact point, on the surface.
    radius_mm, depth_mm : float
        Reach on the surface, and depth under its middle.
    softness : float
        Modulus of bruised flesh over that of sound flesh.
    dent_mm : float
        By how much its middle lies below the round surface.
    """

    along_mm: float
    across_mm: float
    radius_mm: float
    depth_mm: float
    softness: float
    dent_mm: float

    def profile(self, along_mm: FloatArray, across_mm: FloatArray) -> FloatArray:
        """Return 1 in the middle, 0 from the rim on."""
        off_mm2 = (along_mm - self.along_mm) ** 2 + (across_mm - self.across_mm) ** 2
        return np.maximum(1.0 - off_mm2 / self.radius_mm**2, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Face:
    """Where one finger meets the fruit.

    Attributes
    ----------
    curvature_mm : float
        Diameter of the sphere that fits the surface here.
    firmness : float
        Stiffness of the flesh here over the fruit's own.
    contact_mm : tuple of float
        Where the finger touches first, along and across from the axis of closing: fruit is no ball.
    patch : Patch or None
        The bruise, if there is one near.
    """

    curvature_mm: float
    firmness: float
    contact_mm: tuple[float, float]
    patch: Patch | None = None

    def pressure(self, along_mm: FloatArray, across_mm: FloatArray, reach_mm: float) -> FloatArray:
        """Return pressure at places given from the contact point, 1 in the middle if sound."""
        gap = (along_mm**2 + across_mm**2) / reach_mm**2
        if self.patch is None:
            return np.maximum(1.0 - gap, 0.0)
        profile = self.patch.profile(along_mm, across_mm)
        dent_mm = self.patch.dent_mm * profile - least_gap_mm(self)
        deep = np.minimum(self.patch.depth_mm * profile / reach_mm, 1.0)
        give = 1.0 + deep * (1.0 / self.patch.softness - 1.0)
        return np.maximum(1.0 - gap - self.curvature_mm * dent_mm / reach_mm**2, 0.0) / give

    def whole(self, reach_mm: float) -> float:
        """Return the force of the whole face over that of a sound one with the same reach."""
        if self.patch is None:
            return 1.0
        along, across = _lattice(_WHOLE * reach_mm)
        sound = np.maximum(1.0 - (along**2 + across**2) / reach_mm**2, 0.0).sum()
        return float(self.pressure(along, across, reach_mm).sum() / sound)

    def stiffness(self, *, pitch_mm: float, fruit_mm: float) -> float:
        """Return the stiffness of this side over that of a round, sound one of the fruit's size."""
        reach_mm = _reach_mm(self.curvature_mm, _USUAL_SIDE_MM, pitch_mm=pitch_mm)
        # Hertz: force goes as the root of the radius of curvature.
        return self.firmness * math.sqrt(self.curvature_mm / fruit_mm) * self.whole(reach_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Faces:
    """Both sides of a fruit between two fingers."""

    faces: tuple[Face, Face]
    fruit_mm: float
    pitch_mm: float

    @property
    def stiffness(self) -> float:
        """Stiffness of the whole over that of a round, sound fruit."""
        return float((sum(_give(self)) / 2.0) ** -1.5)

    def pixel_shares(
        self, deformation_mm: float, *, grid: PixelGrid, off_centre_mm: tuple[float, float]
    ) -> FloatArray:
        """Return the share of its finger's force that each pixel carries, shape (pixels,).

        Those of a sound face add up to 1, as for all objects; those of a bruised one may not.
        """
        shares = np.zeros(grid.finger.size)
        inner = (np.arange(_POINTS) + 0.5) / _POINTS - 0.5
        give = _give(self)
        for finger, face in enumerate(self.faces):
            mine = grid.finger == finger
            side_mm = max(deformation_mm, 0.0) * give[finger] / sum(give)
            reach_mm = _reach_mm(face.curvature_mm, side_mm, pitch_mm=grid.pitch_mm)
            middle = [grid.along_mm[mine], grid.across_mm[mine]]
            along, across = (
                place[:, None] - off_mm - contact_mm + spread * grid.pitch_mm
                for place, off_mm, contact_mm, spread in zip(
                    middle,
                    off_centre_mm,
                    face.contact_mm,
                    (np.repeat(inner, _POINTS), np.tile(inner, _POINTS)),
                    strict=True,
                )
            )
            sound = np.maximum(1.0 - (along**2 + across**2) / reach_mm**2, 0.0).sum()
            carried = face.pressure(along, across, reach_mm).sum(axis=1)
            shares[mine] = carried / max(sound * face.whole(reach_mm), 1e-12)
        return shares


@lru_cache(maxsize=256)
def least_gap_mm(face: Face) -> float:
    """Return by how much the finger goes further than on a sound face before it touches."""
    if face.patch is None:
        return 0.0
    along, across = _lattice(face.patch.radius_mm + _BESIDE_MM)
    gap_mm = (along**2 + across**2) / face.curvature_mm
    return float(np.min(gap_mm + face.patch.dent_mm * face.patch.profile(along, across)))


@lru_cache(maxsize=256)
def _give(faces: Faces) -> tuple[float, float]:
    """Return how far each side gives way under one force: F = K d ** 1.5 on both."""
    one, other = (
        face.stiffness(pitch_mm=faces.pitch_mm, fruit_mm=faces.fruit_mm) ** (-2 / 3)
        for face in faces.faces
    )
    return one, other


def _reach_mm(curvature_mm: float, side_mm: float, *, pitch_mm: float) -> float:
    """Return the reach of the contact when one side gives way by `side_mm` (`pixel_shares`)."""
    return 0.8 * pitch_mm + math.sqrt(0.5 * curvature_mm * side_mm)


def _lattice(reach_mm: float) -> tuple[FloatArray, FloatArray]:
    """Return places 1/12 of the reach apart, from -reach to reach."""
    line = np.linspace(-reach_mm, reach_mm, 25)
    along, across = np.meshgrid(line, line, indexing="ij")
    return along, across
