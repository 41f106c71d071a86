"""The objects of the paper and other produce, as ranges of random draws.

Stiffness and strength are plausible ranges, not measured by this project. The silicone pads match
the ratios of the manufacturers' moduli, the balls those of their grip ratings; banana, kiwi and
mango match the rupture forces of recorded robot grasps. Sizes stated in the paper (strawberries,
31-41 mm) are used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np

from palpate.twin.ranges import Pair, draw_log_uniform, draw_uniform

if TYPE_CHECKING:
    from palpate.arrays import FloatArray
    from palpate.twin.placement import PixelGrid

ContactShape: TypeAlias = Literal["linear", "hertz"]

#: Coefficient of tape or silicone on dry and damp skins; plausible, not measured.
FRICTION: Pair = (0.35, 0.9)
#: Damage begins at this fraction of the rupture force, where the curves of recorded grasps bend.
YIELD_FRACTION: Pair = (0.75, 0.95)
#: Time constants of relaxation, seconds.
RELAXING_S: tuple[Pair, ...] = ((0.2, 1.0), (1.0, 8.0), (8.0, 80.0))


class Faces(Protocol):
    """Contact faces of an object that is neither flat nor round."""

    def pixel_fractions(
        self, deformation_mm: float, *, grid: PixelGrid, off_centre_mm: tuple[float, float]
    ) -> FloatArray:
        """Return each pixel's fraction of its finger's force, shape (pixels,)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinObject:
    """One object between the fingers.

    The elastic law is F = force_at_1mm_n * (x / 1 mm) ** p, with p = 1 (linear) or 1.5 (Hertz), or
    a given curve. Beyond `yield_n` the slope is lower; at `rupture_n` the object ruptures.
    """

    #: Name in `OBJECTS`.
    name: str
    #: Extent along the closing axis before contact.
    size_mm: float
    #: Shape of the force-deformation curve.
    contact: ContactShape
    #: Elastic force at 1 mm of deformation.
    force_at_1mm_n: float
    #: Fractions of the force that relax, and their time constants.
    relaxing_fractions: tuple[float, ...]
    relaxing_time_s: tuple[float, ...]
    #: Whether the object covers the whole pad; otherwise its contact patch grows with deformation.
    flat: bool
    #: Yield and rupture force; infinite for an unbreakable object.
    yield_n: float = float("inf")
    rupture_n: float = float("inf")
    #: Mass, grams.
    mass_g: float = 50.0
    #: Coefficient between pads and object.
    friction: float = 0.6
    #: Contact faces of an object that is neither flat nor round.
    faces: Faces | None = None
    #: Deformations (mm) and elastic forces (N) instead of the law, rising from (0, 0); linear
    #: interpolation, and extrapolation from the last two points.
    curve: tuple[tuple[float, float], ...] | None = None

    @property
    def exponent(self) -> float:
        """Exponent of the elastic law."""
        return 1.0 if self.contact == "linear" else 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectRange:
    """Ranges of an object of one kind; pairs are (low, high)."""

    size_mm: Pair
    force_at_1mm_n: Pair
    contact: ContactShape = "linear"
    relaxing: Pair = (0.01, 0.03)
    flat: bool = False
    rupture_n: Pair | None = None
    mass_g: Pair = (30.0, 60.0)


def _pad(force_at_1mm_n: float) -> ObjectRange:
    stiffness = (0.95 * force_at_1mm_n, 1.05 * force_at_1mm_n)
    return ObjectRange(size_mm=(39.8, 40.2), force_at_1mm_n=stiffness, flat=True)


def _ball(grip_lbs: float) -> ObjectRange:
    stiffness = (0.135 * grip_lbs, 0.145 * grip_lbs)
    return ObjectRange(size_mm=(49.0, 50.0), force_at_1mm_n=stiffness, relaxing=(0.02, 0.05))


def _springs(n_per_mm: float) -> ObjectRange:
    stiffness = (0.97 * n_per_mm, 1.03 * n_per_mm)
    return ObjectRange(
        size_mm=(44.9, 45.1), force_at_1mm_n=stiffness, relaxing=(0.0, 0.003), flat=True
    )


def _fruit(
    size_mm: Pair, force_at_1mm_n: Pair, rupture_n: Pair, *, hertz: bool = True, mass_g: Pair
) -> ObjectRange:
    return ObjectRange(
        size_mm=size_mm,
        force_at_1mm_n=force_at_1mm_n,
        contact="hertz" if hertz else "linear",
        relaxing=(0.10, 0.35),
        rupture_n=rupture_n,
        mass_g=mass_g,
    )


#: Name -> ranges. Names of the paper's objects come first.
OBJECTS: dict[str, ObjectRange] = {
    "ecoflex-10": _pad(3.4),
    "dragonskin-10": _pad(9.0),
    "dragonskin-20": _pad(20.0),
    "dragonskin-30": _pad(36.0),
    "ball-33lbs": _ball(33),
    "ball-40lbs": _ball(40),
    "ball-44lbs": _ball(44),
    "ball-55lbs": _ball(55),
    "ball-55lbs-b": _ball(56.5),
    "ball-66lbs": _ball(66),
    "springs-2": _springs(2.0),
    "springs-4": _springs(4.0),
    "springs-6": _springs(6.0),
    "springs-8": _springs(8.0),
    "apple": _fruit((60, 70), (12, 25), (45, 90), mass_g=(120, 180)),
    "apple-bruised": _fruit((60, 70), (5, 10), (30, 60), mass_g=(120, 180)),
    "avocado-day-1": _fruit((58, 68), (14, 22), (50, 90), mass_g=(150, 220)),
    "avocado-day-2": _fruit((58, 68), (8, 13), (35, 70), mass_g=(150, 220)),
    "avocado-day-3": _fruit((58, 68), (4.5, 7.5), (20, 45), mass_g=(150, 220)),
    "avocado-day-4": _fruit((58, 68), (2.2, 4), (12, 30), mass_g=(150, 220)),
    "banana": _fruit((29, 38), (1.2, 3.5), (4, 13), hertz=False, mass_g=(100, 160)),
    "strawberry": _fruit((31, 41), (1.2, 3.2), (6, 14), mass_g=(12, 35)),
    "kiwi": _fruit((45, 55), (0.8, 2.4), (3, 7), mass_g=(70, 110)),
    "mango": _fruit((60, 70), (2.5, 6), (7, 16), mass_g=(200, 300)),
    "tomato": _fruit((45, 65), (3, 8), (10, 30), mass_g=(60, 150)),
    "rigid-block": ObjectRange(
        size_mm=(39.9, 40.1), force_at_1mm_n=(400, 600), relaxing=(0.0, 0.001), flat=True
    ),
}


def draw_object(rng: np.random.Generator, name: str | None = None) -> TwinObject:
    """Draw one object.

    `name`: name in `OBJECTS`; by default a random one other than `rigid-block`.
    Raises `ValueError` for an unknown name.

    >>> import numpy as np
    >>> berry = draw_object(np.random.default_rng(1), "strawberry")
    >>> 31 <= berry.size_mm <= 41, berry.contact
    (True, 'hertz')
    """
    if name is None:
        name = str(rng.choice([known for known in OBJECTS if known != "rigid-block"]))
    if name not in OBJECTS:
        raise ValueError(f"no twin object {name!r}; available: {', '.join(OBJECTS)}")
    kind = OBJECTS[name]
    fractions = rng.dirichlet((2.0, 2.0, 2.0)) * draw_uniform(rng, kind.relaxing)
    rupture_n = draw_uniform(rng, kind.rupture_n) if kind.rupture_n else float("inf")
    return TwinObject(
        name=name,
        size_mm=draw_uniform(rng, kind.size_mm),
        contact=kind.contact,
        force_at_1mm_n=draw_log_uniform(rng, kind.force_at_1mm_n),
        relaxing_fractions=tuple(float(part) for part in fractions),
        relaxing_time_s=tuple(draw_log_uniform(rng, pair) for pair in RELAXING_S),
        flat=kind.flat,
        yield_n=rupture_n * draw_uniform(rng, YIELD_FRACTION),
        rupture_n=rupture_n,
        mass_g=draw_uniform(rng, kind.mass_g),
        # A separate stream preserves the other draws of a seed.
        friction=draw_uniform(rng.spawn(1)[0], FRICTION),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """True values in a world; names and meanings as in the output of `palpate grasp`."""

    #: Extent of the object along the closing axis before contact; None without an object.
    size_mm: float | None
    #: Mean relative change over all pixels at the horizon of the final hold.
    settled_percent: float
    #: Grip force, the mean of the fingers' normal forces, at that horizon.
    force_n: float
    #: The object's own secant stiffness at that force; None without contact.
    stiffness_n_per_mm: float | None
    #: Largest contact force up to now.
    peak_force_n: float
    #: Whether the force ever passed the object's yield force.
    damaged: bool
    #: Time of the damage on the rig's clock; None without damage, or if unknown.
    damaged_s: float | None = None

    def to_dict(self) -> dict[str, float | bool | None]:
        """Return the true values as in the output of commands."""
        return {name: getattr(self, name) for name in self.__slots__}
