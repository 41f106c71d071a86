"""The items that `palpate sort` grasps: a simulated crate, or items named line by line."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Protocol

from palpate.estimate.damage import DamageModel
from palpate.grasp.planning import plan_grasp
from palpate.produce.records import Item
from palpate.produce.sorting.hand import SortingHand
from palpate.produce.sorting.rules import RuleBook
from palpate.produce.sorting.score import where_it_belongs
from palpate.produce.store.writing import calibration_id_of
from palpate.rig import Rig, open_rig
from palpate.rig.simulated import calibrate_twin
from palpate.twin.crate import CRATE_TAUGHT, CrateItem, CrateTable, draw_crate, draw_mixed_crate

#: Fraction of a simulated crate that is of unlabelled kinds.
_STRANGERS_SHARE = 1 / 6
#: The rig that comes with a crate of the twin.
_SIMULATED = "sim-rigid"


class Supply(Protocol):
    """Items, one after the other, and the hand that grasps them."""

    @property
    def hand(self) -> SortingHand:
        """The hand."""
        ...

    @property
    def calibration(self) -> str:
        """The calibration's text."""
        ...

    def names(self) -> Iterator[str]:
        """Yield the items as they come."""
        ...

    def lay(self, name: str, *, turn: int) -> None:
        """Place an item between the open fingers, after this many turns."""
        ...

    def belongs(self, name: str, *, book: RuleBook) -> str | None:
        """Return the bin that an item truly belongs to; None where nobody knows."""
        ...

    def close(self) -> None:
        """Let go of the devices."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedCrate:
    """A mixed crate of the twin."""

    hand: SortingHand
    calibration: str
    #: The simulated world.
    table: CrateTable
    #: What is to be sorted.
    crate: Mapping[str, CrateItem]
    #: Labelled items of each kind, to teach from.
    teaching: Mapping[str, CrateItem]

    def names(self) -> Iterator[str]:
        """Yield the items of the crate."""
        yield from self.crate

    def iterate_labelled(self) -> Iterator[Item]:
        """Yield what teaches, as a person would label it."""
        for item in self.teaching.values():
            yield Item(item_id=item.item_id, kind=item.kind, batch="taught")

    def lay(self, name: str, *, turn: int) -> None:
        """Lay an item between the fingers."""
        item = self.crate[name] if name in self.crate else self.teaching[name]
        self.table.bring(item, turn=turn)

    def belongs(self, name: str, *, book: RuleBook) -> str | None:
        """Return where the rules would send the item if all of it were known."""
        item = self.crate[name]
        return where_it_belongs(book, kind=item.kind, taught=item.taught, size_mm=item.mean.size_mm)

    def close(self) -> None:
        """Let go of the devices."""
        self.table.array.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedByLine:
    """Items before real fingers: each line of standard input is the name of one that lies there.

    A bar-code reader that types what it reads will do.
    """

    hand: SortingHand
    calibration: str
    rig: Rig

    def names(self) -> Iterator[str]:
        """Yield names until the input ends or a line is empty."""
        while True:
            print("lay an item between the fingers, then its name (none: end):", file=sys.stderr)
            name = sys.stdin.readline().strip()
            if not name:
                return
            yield name

    def lay(self, name: str, *, turn: int) -> None:
        """Ask for the item to be turned, where it was grasped already."""
        if turn:
            print(f"{name}: unsure; turn it, then press Enter:", file=sys.stderr)
            sys.stdin.readline()

    def belongs(self, name: str, *, book: RuleBook) -> str | None:
        """Return None: the true bin is not known."""
        return None

    def close(self) -> None:
        """Let go of the devices."""
        self.rig.close()


def open_supply(
    name: str,
    *,
    seed: int,
    items: int,
    taught: int,
    target_force_n: float | None,
    damage: DamageModel | None,
) -> Supply:
    """Open the rig of a name; the simulated one is calibrated as by a user, with a crate drawn.

    Raises `InputError` or `DeviceError` if there is no such rig, or it does not open.
    """
    if name != _SIMULATED:
        rig = open_rig(name)
        hand, calibration = _hand(rig, target_force_n, damage), rig.calibration.as_text()
        return NamedByLine(hand=hand, calibration=calibration, rig=rig)
    table = CrateTable(sensor=seed, seed=seed + 500_009)
    rig = Rig(
        name=_SIMULATED,
        array=table.array,
        gripper=table.gripper,
        clock=table.clock,
        calibration=calibrate_twin(seed=seed, level="lab", apart_from=""),
        origin="twin",
    )
    crate = draw_mixed_crate(
        items, seed=seed, strangers_share=_STRANGERS_SHARE, prefix=f"crate-{seed}"
    )
    teaching = draw_crate(list(CRATE_TAUGHT) * taught, seed=seed + 1, prefix=f"taught-{seed}")
    return SimulatedCrate(
        hand=_hand(rig, target_force_n, damage),
        calibration=rig.calibration.as_text(),
        table=table,
        crate={item.item_id: item for item in crate},
        teaching={item.item_id: item for item in teaching},
    )


def _hand(rig: Rig, target_force_n: float | None, damage: DamageModel | None) -> SortingHand:
    return SortingHand(
        array=rig.array,
        gripper=rig.gripper,
        clock=rig.clock,
        plan=plan_grasp(
            rig.calibration, gripper=rig.gripper, target_force_n=target_force_n, damage=damage
        ),
        rig=rig.name,
        origin=rig.origin,
        calibration_id=calibration_id_of(rig.calibration.as_text()),
        now=partial(datetime.now, UTC),
    )
