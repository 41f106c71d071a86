"""Simulated mixed crates: items of several kinds with slightly different sides.

The drawn kind, size and strength of each item are the truth and hidden from the sorter. The kinds
and their ranges were fixed before any measurement on them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.clock import ManualClock
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import RELAXING_S, YIELD_FRACTION, TwinObject
from palpate.twin.ranges import Pair, draw_log_uniform, draw_uniform
from palpate.twin.world import World

#: Pause after an item was placed between the open fingers, seconds.
_STILL_S = 1.0


@dataclass(frozen=True, slots=True)
class CrateKind:
    """Ranges of the items of one kind in a mixed crate; pairs are (low, high)."""

    #: Flesh deforms according to Hertz, a shell linearly.
    law: Literal["flesh", "shell"]
    #: Mean diameter of the sides on the closing axis; each item is grasped across its short side.
    size_mm: Pair
    #: Flesh: apparent modulus between plates, MPa, which defines the Hertz law together with the
    #: size. Shell: stiffness, N/mm.
    stiffness: Pair
    #: Rupture force; None for unbreakable items.
    rupture_n: Pair | None
    #: Largest deviation of a side's diameter from the mean, as a fraction.
    out_of_round: float
    #: Mass, grams.
    mass_g: Pair
    #: Fraction of the force that relaxes during a hold.
    relaxing: Pair = (0.10, 0.30)


#: Poisson's ratio of flesh; scatter (log sd) of the stiffness from side to side of one item.
CRATE_POISSON, CRATE_SIDE_LOG_SD = 0.35, 0.08

#: Trained kinds. Sizes are usual commercial sizes. Moduli are orders of magnitude from the
#: literature on whole fruit between plates (ASAE S368; Mohsenin, Physical Properties of Plant and
#: Animal Materials, 1986): a few tenths of an MPa for ripe fruit, a few MPa for crisp fruit. The
#: kiwi matches recorded robot grasps; shells match hens' eggs pressed across. All values were fixed
#: before any measurement on them. Several kinds overlap, as in a shop.
TRAINED_KINDS: dict[str, CrateKind] = {
    "cherry-tomato": CrateKind("flesh", (22, 31), (0.8, 2.2), (9, 22), 0.04, (8, 18)),
    "strawberry": CrateKind("flesh", (27, 40), (0.25, 0.8), (6, 14), 0.08, (10, 32), (0.15, 0.35)),
    "lime": CrateKind("flesh", (41, 50), (1.5, 3.5), (60, 120), 0.03, (45, 75)),
    "egg": CrateKind("shell", (41, 46), (90, 180), (28, 45), 0.01, (50, 68), (0, 0.005)),
    "kiwi": CrateKind("flesh", (45, 55), (0.3, 0.9), (4.5, 9), 0.05, (70, 110)),
    "tomato": CrateKind("flesh", (50, 62), (0.7, 1.8), (15, 40), 0.04, (70, 140)),
    "peach": CrateKind("flesh", (57, 67), (0.9, 2.5), (20, 50), 0.04, (110, 180)),
    "avocado": CrateKind("flesh", (58, 68), (0.2, 0.6), (12, 30), 0.04, (150, 220)),
    "apple": CrateKind("flesh", (58, 68), (3, 6.5), (45, 90), 0.03, (110, 180)),
}

#: Untrained kinds in a crate. Some resemble a trained kind.
UNTRAINED_KINDS: dict[str, CrateKind] = {
    "grape": CrateKind("flesh", (16, 22), (0.4, 1.2), (6, 14), 0.08, (4, 9)),
    "walnut": CrateKind("shell", (29, 37), (120, 300), (150, 400), 0.05, (9, 15), (0, 0.01)),
    "mushroom": CrateKind("flesh", (36, 50), (0.08, 0.25), (8, 20), 0.08, (12, 35), (0.2, 0.4)),
    "potato": CrateKind("flesh", (42, 60), (3, 6), (150, 400), 0.12, (60, 150)),
    "foam-ball": CrateKind("flesh", (50, 66), (0.02, 0.08), None, 0.01, (4, 12), (0.05, 0.15)),
    "stone": CrateKind("shell", (30, 60), (400, 600), None, 0.15, (60, 300), (0, 0.001)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CrateItem:
    """One item of a crate."""

    #: Unique name in its crate.
    item_id: str
    #: True kind.
    kind: str
    #: Whether its kind is a trained kind.
    is_trained: bool
    #: The item with equal sides.
    mean: TwinObject
    #: Largest deviation of a side's diameter from the mean, as a fraction.
    out_of_round: float
    #: Seed of the sides.
    seed: int

    def side(self, turn: int) -> TwinObject:
        """Return the item turned to side number `turn`, with that side's diameter and stiffness.

        >>> item = draw_crate(["kiwi"], seed=1)[0]
        >>> item.side(0) == item.side(0), item.side(0) == item.side(1)
        (True, False)
        """
        rng = np.random.default_rng([self.seed, turn])
        size = self.mean.size_mm * (1.0 + self.out_of_round * rng.uniform(-1.0, 1.0))
        stiffness = self.mean.force_at_1mm_n * math.exp(CRATE_SIDE_LOG_SD * rng.standard_normal())
        return replace(self.mean, size_mm=float(size), force_at_1mm_n=float(stiffness))


def draw_crate(kinds: Sequence[str], *, seed: int, prefix: str = "item") -> list[CrateItem]:
    """Draw one item of each given kind, in order.

    Raises `ValueError` for an unknown kind.

    >>> [item.kind for item in draw_crate(["egg", "walnut"], seed=3)]
    ['egg', 'walnut']
    """
    known = {**TRAINED_KINDS, **UNTRAINED_KINDS}
    items = []
    for number, kind in enumerate(kinds):
        if kind not in known:
            raise ValueError(f"no crate kind {kind!r}; available: {', '.join(known)}")
        rng = np.random.default_rng([seed, 30, number])
        items.append(
            CrateItem(
                item_id=f"{prefix}-{number + 1:03d}",
                kind=kind,
                is_trained=kind in TRAINED_KINDS,
                mean=_draw_item(rng, kind, known[kind]),
                out_of_round=known[kind].out_of_round,
                seed=int(rng.integers(2**31)),
            )
        )
    return items


def draw_mixed_crate(
    items: int, *, seed: int, unknown_fraction: float = 0.0, prefix: str = "item"
) -> list[CrateItem]:
    """Draw a shuffled crate of trained kinds and a fraction of untrained kinds."""
    rng = np.random.default_rng([seed, 31])
    untrained_items = round(items * unknown_fraction)
    trained, untrained = list(TRAINED_KINDS), list(UNTRAINED_KINDS)
    kinds = [trained[k % len(trained)] for k in range(items - untrained_items)]
    kinds += [untrained[k % len(untrained)] for k in range(untrained_items)]
    return draw_crate(rng.permutation(kinds).tolist(), seed=seed, prefix=prefix)


def _draw_item(rng: np.random.Generator, name: str, kind: CrateKind) -> TwinObject:
    size_mm = draw_uniform(rng, kind.size_mm)
    rupture_n = math.inf if kind.rupture_n is None else draw_uniform(rng, kind.rupture_n)
    stiffness = draw_log_uniform(rng, kind.stiffness)
    if kind.law == "flesh":
        stiffness = hertz_force_at_1mm_n(stiffness, size_mm=size_mm)
    fractions = rng.dirichlet((2.0, 2.0, 2.0)) * draw_uniform(rng, kind.relaxing)
    return TwinObject(
        name=name,
        size_mm=size_mm,
        contact="hertz" if kind.law == "flesh" else "linear",
        force_at_1mm_n=stiffness,
        relaxing_fractions=tuple(float(part) for part in fractions),
        relaxing_time_s=tuple(draw_log_uniform(rng, pair) for pair in RELAXING_S),
        flat=False,
        yield_n=rupture_n * draw_uniform(rng, YIELD_FRACTION),
        rupture_n=rupture_n,
        mass_g=draw_uniform(rng, kind.mass_g),
    )


def hertz_force_at_1mm_n(modulus_mpa: float, *, size_mm: float) -> float:
    """Return the force that compresses a ball between plates by 1 mm (Hertz; ASAE S368).

    Each side is indented by 0.5 mm: F = 4/3 E / (1 - nu**2) sqrt(d/2) (1/2)**1.5.

    >>> round(hertz_force_at_1mm_n(4.0, size_mm=64.0), 1)
    12.2
    """
    plane_mpa = modulus_mpa / (1.0 - CRATE_POISSON**2)
    return 4.0 / 3.0 * plane_mpa * math.sqrt(size_mm / 2.0) * math.sqrt(0.125)


class CrateTable:
    """A gripper over a table that receives crate items one by one.

    `sensor`: seed of the sensor and the gripper, as in their calibration.
    `seed`: seed of the session.
    """

    def __init__(self, *, sensor: int, seed: int, level: str = "lab") -> None:
        self._world = World(None, seed=seed, sheet_seed=sensor, level=level)
        self.array, self.gripper = TwinArray(self._world), TwinGripper(self._world)

    @property
    def clock(self) -> ManualClock:
        """The clock of this session."""
        return self._world.clock

    def place(self, item: CrateItem, *, turn: int = 0) -> None:
        """Open the gripper, remove the previous item, and place an item between the fingers."""
        self.gripper.release()
        self._wait()
        while self._world.is_moving(self.clock.now_s()):
            self._wait()
        self._world.place(item.side(turn))
        self._wait()

    def is_damaged(self) -> bool:
        """Return whether the present item has ever been pressed beyond its yield force."""
        return self._world.truth().damaged

    def _wait(self) -> None:
        # Unread frames need not be scanned, and old frames must not remain in the queue.
        self.array.skip_until(self.clock.now_s() + _STILL_S)
