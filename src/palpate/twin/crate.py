"""A mixed crate on the twin: items of several kinds, each of their sides a little different.

What is drawn here is the truth that nobody who sorts may see: kind, size and strength of each item.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.clock import ManualClock
from palpate.twin.crate_kinds import (
    CRATE_POISSON,
    CRATE_SIDE_LOG_SD,
    CRATE_STRANGERS,
    CRATE_TAUGHT,
    CrateKind,
)
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject
from palpate.twin.ranges import log_uniform, uniform
from palpate.twin.world import World

#: Damage begins at this share of the rupture force, as for other fruit of the twin.
_YIELD_SHARE = (0.75, 0.95)
#: Time constants of relaxation, as for other fruit of the twin.
_RELAXING_S = ((0.2, 1.0), (1.0, 8.0), (8.0, 80.0))
#: After an item was laid between the open fingers, the hand is left still for this long.
_STILL_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CrateItem:
    """One item of a crate."""

    #: Name, unlike any other's in its crate.
    item_id: str
    #: What it truly is.
    kind: str
    #: Whether its kind is one that is taught.
    taught: bool
    #: The item as it would be if every side were the same.
    mean: TwinObject
    #: How far, as a share, the diameter at a side may differ from the mean.
    out_of_round: float
    #: Seed of its sides.
    seed: int

    def side(self, turn: int) -> TwinObject:
        """Return the item as it lies after this many turns: another diameter, another place.

        >>> item = draw_crate(["kiwi"], seed=1)[0]
        >>> item.side(0) == item.side(0), item.side(0) == item.side(1)
        (True, False)
        """
        rng = np.random.default_rng([self.seed, turn])
        size = self.mean.size_mm * (1.0 + self.out_of_round * rng.uniform(-1.0, 1.0))
        stiffness = self.mean.force_at_1mm_n * math.exp(CRATE_SIDE_LOG_SD * rng.standard_normal())
        return replace(self.mean, size_mm=float(size), force_at_1mm_n=float(stiffness))


def draw_crate(kinds: Sequence[str], *, seed: int, prefix: str = "item") -> list[CrateItem]:
    """Draw one item of each kind named, in this order.

    Raises `ValueError` if there is no such kind.

    >>> [item.kind for item in draw_crate(["egg", "walnut"], seed=3)]
    ['egg', 'walnut']
    """
    known = {**CRATE_TAUGHT, **CRATE_STRANGERS}
    items = []
    for number, kind in enumerate(kinds):
        if kind not in known:
            raise ValueError(f"no crate kind {kind!r}; there are: {', '.join(known)}")
        rng = np.random.default_rng([seed, 30, number])
        items.append(
            CrateItem(
                item_id=f"{prefix}-{number + 1:03d}",
                kind=kind,
                taught=kind in CRATE_TAUGHT,
                mean=_drawn(rng, kind, known[kind]),
                out_of_round=known[kind].out_of_round,
                seed=int(rng.integers(2**31)),
            )
        )
    return items


def mixed_crate(
    items: int, *, seed: int, strangers_share: float = 0.0, prefix: str = "item"
) -> list[CrateItem]:
    """Draw a crate of taught kinds in equal parts, with a share of strangers, shuffled."""
    rng = np.random.default_rng([seed, 31])
    strangers = round(items * strangers_share)
    taught, unknown = list(CRATE_TAUGHT), list(CRATE_STRANGERS)
    kinds = [taught[k % len(taught)] for k in range(items - strangers)]
    kinds += [unknown[k % len(unknown)] for k in range(strangers)]
    return draw_crate(rng.permutation(kinds).tolist(), seed=seed, prefix=prefix)


def _drawn(rng: np.random.Generator, name: str, kind: CrateKind) -> TwinObject:
    size_mm = uniform(rng, kind.size_mm)
    rupture_n = math.inf if kind.rupture_n is None else uniform(rng, kind.rupture_n)
    if kind.modulus_mpa is not None:
        stiffness = hertz_force_at_1mm_n(log_uniform(rng, kind.modulus_mpa), size_mm=size_mm)
    elif kind.shell_n_per_mm is not None:
        stiffness = log_uniform(rng, kind.shell_n_per_mm)
    else:
        raise ValueError(f"crate kind {name!r} has neither a modulus nor a shell")
    share = rng.dirichlet((2.0, 2.0, 2.0)) * uniform(rng, kind.relaxing)
    return TwinObject(
        name=name,
        size_mm=size_mm,
        contact="linear" if kind.modulus_mpa is None else "hertz",
        force_at_1mm_n=stiffness,
        relaxing_share=tuple(float(part) for part in share),
        relaxing_time_s=tuple(log_uniform(rng, pair) for pair in _RELAXING_S),
        flat=False,
        yield_n=rupture_n * uniform(rng, _YIELD_SHARE),
        rupture_n=rupture_n,
        mass_g=uniform(rng, kind.mass_g),
    )


def hertz_force_at_1mm_n(modulus_mpa: float, *, size_mm: float) -> float:
    """Return the force at 1 mm between two plates of a ball of that modulus (Hertz; ASAE S368).

    Each side is indented by half: F = 4/3 E / (1 - nu**2) sqrt(d/2) (1/2)**1.5 at 1 mm.

    >>> round(hertz_force_at_1mm_n(4.0, size_mm=64.0), 1)
    12.2
    """
    plane_mpa = modulus_mpa / (1.0 - CRATE_POISSON**2)
    return 4.0 / 3.0 * plane_mpa * math.sqrt(size_mm / 2.0) * math.sqrt(0.125)


class CrateTable:
    """A hand over a table to which items of a crate are brought one by one.

    `sensor`: seed of the sensor and the gripper, as for calibration.
    `seed`: seed of the session.
    """

    def __init__(self, *, sensor: int, seed: int, level: str = "lab") -> None:
        self._world = World(None, seed=seed, sheet_seed=sensor, level=level)
        self.array, self.gripper = TwinArray(self._world), TwinGripper(self._world)

    @property
    def clock(self) -> ManualClock:
        """The clock of this session."""
        return self._world.clock

    def bring(self, item: CrateItem, *, turn: int = 0) -> None:
        """Open the hand, take away what is there, and lay an item between the fingers."""
        self.gripper.release()
        self._wait(_STILL_S)
        while self._world.moving(self.clock.now_s()):
            self._wait(_STILL_S)
        self._world.place(item.side(turn))
        self._wait(_STILL_S)

    def damaged(self) -> bool:
        """Whether the item that lies there has ever been pressed beyond its yield."""
        return self._world.truth().damaged

    def _wait(self, seconds: float) -> None:
        # Frames that nobody looks at need not be scanned, and old ones must not wait in a queue.
        self.array.skip_until(self.clock.now_s() + seconds)
