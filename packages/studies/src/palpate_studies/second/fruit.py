"""Second generator of fruit: bruises and ripening curves that no estimator assumes.

The first generator's bruise has the profile of a paraboloid and always a dent; its avocados soften
along one S-shaped curve. These alternatives were fixed before anything was scored on them:

- **bruises**: constant softness up to a steep rim, with a corky, sound core of half the radius (an
  old bruise dries from the middle); every second bruise has no dent.
- **rot** (disease): a soft spot of the first generator without a dent, as deep as its radius, with
  a quarter of a bruise's modulus. The values are guesses; no measurement of rot was found.
- **ripening**: `pause`: no change for some days, then a linear fall of the logarithm; `two steps`:
  half of the fall, a pause of one to two days, the other half; `sudden`: an exponential approach to
  the soft end with an abrupt start.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate_studies.twin_apple import Apple, Face, Patch
from palpate_studies.twin_avocado import Avocado

#: Radii of the sound core and of the inner edge of the rim, relative to the bruise.
_CORE, _RIM = 0.5, 0.85
#: Modulus of rotten flesh over that of bruised flesh.
_ROT_SOFTNESS = 0.25
#: Softening courses, used in turn.
COURSES = ("pause", "two steps", "sudden")


@dataclass(frozen=True, kw_only=True)
class CorkyPatch(Patch):
    """A bruise with a sound core and a steep rim."""

    def profile(self, along_mm: FloatArray, across_mm: FloatArray) -> FloatArray:
        """Return the relative depth: 1 in the ring, 0 outside, 0.5 in the core."""
        off = np.hypot(along_mm - self.along_mm, across_mm - self.across_mm) / self.radius_mm
        ring = np.clip((1.0 - off) / (1.0 - _RIM), 0.0, 1.0)
        return np.asarray(np.where(off < _CORE, 0.5 * ring, ring))


@dataclass(frozen=True, kw_only=True)
class CorkyApple(Apple):
    """An apple whose bruise is corky."""

    def _face(self, angle_deg: float, *, across: float) -> Face:
        face = Apple._face(self, angle_deg, across=across)
        if face.patch is None or self.bruise is None:
            return face
        values = {field.name: getattr(face.patch, field.name) for field in fields(Patch)}
        if int(self.bruise.angle_deg) % 2:
            values["dent_mm"] = 0.0
        known = {field.name: getattr(face, field.name) for field in fields(Face)}
        return Face(**known | {"patch": CorkyPatch(**values)})


def corky(apple: Apple) -> Apple:
    """Return the same apple with its bruise of the second generator."""
    return CorkyApple(**{field.name: getattr(apple, field.name) for field in fields(Apple)})


def rotten(apple: Apple) -> Apple:
    """Return the same apple with rot in place of its bruise."""
    if apple.bruise is None:
        return apple
    spot = replace(
        apple.bruise,
        depth_mm=apple.bruise.diameter_mm / 2.0,
        softness=apple.bruise.softness * _ROT_SOFTNESS,
        dent_mm=0.0,
    )
    return replace(apple, bruise=spot)


@dataclass(frozen=True, kw_only=True)
class OtherAvocado(Avocado):
    """An avocado with another softening course.

    Attributes
    ----------
    course : {"pause", "two steps", "sudden"}
        Softening course; see the module docstring.
    """

    course: str

    def force_at_1mm_n(self, day: float) -> float:
        """Return the mean elastic force at 1 mm on a day."""
        # Same midpoint and duration as in the first generator: about four paces.
        gone = (day - self.half_day) / self.pace_days
        if self.course == "pause":
            done = np.clip(0.5 + gone / 5.0, 0.0, 1.0)
        elif self.course == "two steps":
            done = 0.5 * np.clip(1.0 + (gone + 0.7) / 2.0, 0.0, 1.0)
            done += 0.5 * np.clip((gone - 0.7) / 2.0, 0.0, 1.0)
        else:
            done = -np.expm1(-max(gone + 1.0, 0.0) / 1.4)
        return float(self.hard_n * (self.softest_n / self.hard_n) ** done)


def other_avocado(fruit: Avocado, *, course: str) -> OtherAvocado:
    """Return the same fruit with another softening course."""
    known = {field.name: getattr(fruit, field.name) for field in fields(Avocado)}
    return OtherAvocado(**known, course=course)
