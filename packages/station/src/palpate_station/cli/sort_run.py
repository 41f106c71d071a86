"""Sort items of the store, or items that a rig grasps."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TypeAlias

from palpate.cli.output import print_message
from palpate.errors import DeviceError, InputError
from palpate.grasp.planning import plan_grasp
from palpate.measurement import Measurement
from palpate.object.damage import DamageModel
from palpate.rig import Rig, open_rig
from palpate.twin.crate import TRAINED_KINDS, CrateItem, CrateTable, draw_crate, draw_mixed_crate
from palpate.twin.rig import calibrate_twin
from palpate_station.cli.items import open_store
from palpate_station.cli.sort_report import SortReport
from palpate_station.identify.identifier import Identifier
from palpate_station.identify.kinds import identity_verdict, item_features, learn_kinds
from palpate_station.records import Grasp, Item, Verdict
from palpate_station.sorting.hand import SortingHand, TimedGrasp
from palpate_station.sorting.rules import RuleBook, decide
from palpate_station.sorting.rules_file import check_kinds
from palpate_station.sorting.run import Sorted, bin_verdict, combine_evidence, sort_item
from palpate_station.sorting.score import find_true_bin
from palpate_station.store import Store
from palpate_station.store.writing import calibration_id_of

#: Grasps of each training item; two grasps measure the variation within an item.
_TRAINING_GRASPS = 2
_BROKEN = {"sensor_lost": "the sensor was lost", "gripper_fault": "the gripper failed"}


def sort_from_store(
    report: SortReport, *, rules: Path, store: str | None, batch: str | None
) -> None:
    """Sort stored items by their grasps and verdicts.

    Raises `InputError` if the batch does not exist, or no item was grasped.
    """
    with open_store(store) as stored:
        asked = stored.items() if batch is None else stored.items_of_batch(batch)
        found = [(item, stored.grasps_of(item.item_id)) for item in asked]
        found = [(item, grasps) for item, grasps in found if grasps]
        if not found:
            which = "the store" if batch is None else f"batch {batch!r}"
            raise InputError(f"{which} contains no grasped items; grasp some, or give --rig")
        labelled = {item.kind for item, _ in found if item.kind is not None}
        guess = any(item.kind is None for item, _ in found)
        identifier = _learn_kinds(stored, report.book, rules=rules, labelled=labelled, guess=guess)
        for item, grasps in found:
            verdicts = stored.verdicts_of(item.item_id)
            evidence = combine_evidence(
                grasps, identifier=identifier, kind=item.kind, verdicts=verdicts
            )
            done = Sorted(
                item_id=item.item_id,
                decision=decide(report.book, evidence),
                identity=evidence.identity,
                size_mm=evidence.size_mm,
                grasps=tuple(grasps),
                grasping_s=0.0,
            )
            report.add(done, true_bin=None)


def sort_with_rig(
    report: SortReport, supply: Supply, *, rules: Path, store: str | None, batch: str | None
) -> None:
    """Grasp and sort each item; store grasps and verdicts if there is a store.

    Raises `InputError` if the rules use quantities that the gripper can't measure or kinds without
    labelled items; `DeviceError` if a device fails.
    """
    simulated = isinstance(supply, SimulatedCrate)
    _check_measurable(report.book, supply, rules=rules)
    with nullcontext() if simulated and store is None else Store.open(store) as stored:
        identifier = None
        if report.book.has_condition("class"):
            if isinstance(supply, SimulatedCrate) and (stored is None or not stored.items(limit=1)):
                identifier = _grasp_training_items(supply, stored)
                check_kinds(report.book, known_kinds=identifier.kinds, path=rules)
            elif stored is not None:
                identifier = _learn_kinds(stored, report.book, rules=rules)
        for name in supply.names():
            kind: str | None = None
            verdicts: tuple[Verdict, ...] = ()
            if stored is not None:
                stored.add_item(Item(item_id=name, batch=batch))
                kind, verdicts = stored.item(name).kind, stored.verdicts_of(name)
            done = sort_item(
                name,
                book=report.book,
                identifier=identifier,
                grasp=partial(_grasp, name, supply, stored),
                kind=kind,
                verdicts=verdicts,
            )
            if stored is not None:
                now = supply.hand.now()
                if done.identity is not None and done.identity.grasps:
                    stored.add_verdict(identity_verdict(name, done.identity, given_at=now))
                stored.add_verdict(bin_verdict(done, given_at=now))
            report.add(done, true_bin=supply.find_true_bin(name, book=report.book))
        if stored is not None and (waiting := stored.try_send()):
            print_message(f"palpate: {waiting}")


def _learn_kinds(
    stored: Store,
    book: RuleBook,
    *,
    rules: Path,
    labelled: Collection[str] = (),
    guess: bool = True,
) -> Identifier | None:
    """Learn kinds from the store if the rules use them; otherwise return None."""
    if not book.has_condition("class"):
        return None
    identifier = learn_kinds(stored) if guess else None
    known_kinds = () if identifier is None else identifier.kinds
    check_kinds(book, known_kinds={*known_kinds, *labelled}, path=rules)
    return identifier


def _check_measurable(book: RuleBook, supply: Supply, *, rules: Path) -> None:
    """Raise `InputError` for rules on quantities that pressure-driven fingers can't measure."""
    if supply.hand.plan.gripper.drive == "width":
        return
    for rule in book.rules:
        if rule.has_condition("class") or rule.has_condition("size_mm"):
            raise InputError(
                f"rules file {rules} line {rule.line}: requires class or size, but fingers driven "
                "by pressure measure neither size nor stiffness; use fingers driven by width"
            )


def _grasp_training_items(supply: SimulatedCrate, stored: Store | None) -> Identifier:
    """Grasp the labelled training items; return an identifier trained on them."""
    print_message(f"training with {len(supply.training)} labelled items (simulated) ...")
    found = []
    for item in supply.training.values():
        if stored is not None:
            stored.add_item(Item(item_id=item.item_id, kind=item.kind, batch="taught"))
        grasps: list[Grasp] = []
        for turn in range(_TRAINING_GRASPS):
            size = grasps[-1].measurements.get("size_mm") if grasps else None
            grasps.append(_grasp(item.item_id, supply, stored, turn, size).grasp)
        found.append((str(item.kind), item_features(grasps)))
    return Identifier(found)


def _grasp(
    name: str, supply: Supply, stored: Store | None, turn: int, size: Measurement | None
) -> TimedGrasp:
    """Place an item, grasp it and store the grasp.

    Raises `DeviceError` if equipment fails, `KeyboardInterrupt` if the grasp was stopped.
    """
    supply.place_item(name, turn=turn)
    timed = supply.hand.grasp(name, expected=size)
    outcome = str(timed.grasp.outcome)
    if outcome == "stopped":
        raise KeyboardInterrupt
    if outcome in _BROKEN:
        raise DeviceError(f"while grasping {name} {_BROKEN[outcome]}; run `palpate doctor`")
    if stored is not None:
        stored.add_grasp(timed.grasp, calibration=supply.calibration)
    return timed


#: Fraction of items of unlabelled kinds in a simulated crate.
_UNKNOWN_FRACTION = 1 / 6
#: Name of the rig with a simulated crate.
_SIMULATED = "sim-rigid"


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedCrate:
    """A simulated crate of mixed produce."""

    hand: SortingHand
    calibration: str
    #: The simulated world.
    table: CrateTable
    #: Items to sort.
    crate: Mapping[str, CrateItem]
    #: Labelled items of each kind, for training.
    training: Mapping[str, CrateItem]

    def names(self) -> Iterator[str]:
        """Yield the items of the crate."""
        yield from self.crate

    def place_item(self, name: str, *, turn: int) -> None:
        """Place an item between the fingers."""
        item = self.crate[name] if name in self.crate else self.training[name]
        self.table.place(item, turn=turn)

    def find_true_bin(self, name: str, *, book: RuleBook) -> str | None:
        """Return the bin for the item's true properties according to the rules."""
        item = self.crate[name]
        return find_true_bin(
            book, kind=item.kind, is_trained=item.is_trained, size_mm=item.mean.size_mm
        )

    def close(self) -> None:
        """Release the devices."""
        self.table.array.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedByLine:
    """Items placed by the user, with names from lines of standard input.

    A bar-code reader with keyboard output can enter the names.
    """

    hand: SortingHand
    calibration: str
    rig: Rig

    def names(self) -> Iterator[str]:
        """Yield names until the input ends or a line is empty."""
        while True:
            print_message("place an item between the fingers and enter its name (empty line: end):")
            name = sys.stdin.readline().strip()
            if not name:
                return
            yield name

    def place_item(self, name: str, *, turn: int) -> None:
        """Prompt to turn the item before a repeated grasp."""
        if turn:
            print_message(f"{name}: uncertain; turn the item, then press Enter:")
            sys.stdin.readline()

    def find_true_bin(self, name: str, *, book: RuleBook) -> str | None:
        """Return None: the true bin is unknown."""
        return None

    def close(self) -> None:
        """Release the devices."""
        self.rig.close()


#: A sequence of items and the gripper that grasps them.
Supply: TypeAlias = SimulatedCrate | NamedByLine


def open_supply(
    name: str,
    *,
    seed: int,
    items: int,
    training_items: int,
    target_force_n: float | None,
    damage: DamageModel | None,
) -> Supply:
    """Open a rig; for the simulated rig, also calibrate it and draw a crate.

    `training_items`: number of labelled items of each simulated kind.
    Raises `InputError` if the rig does not exist; `DeviceError` if the rig can't be opened.
    """
    if name != _SIMULATED:
        rig = open_rig(name)
        hand, calibration = _make_hand(rig, target_force_n, damage), rig.calibration.as_text()
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
        items, seed=seed, unknown_fraction=_UNKNOWN_FRACTION, prefix=f"crate-{seed}"
    )
    training = draw_crate(
        list(TRAINED_KINDS) * training_items, seed=seed + 1, prefix=f"labelled-{seed}"
    )
    return SimulatedCrate(
        hand=_make_hand(rig, target_force_n, damage),
        calibration=rig.calibration.as_text(),
        table=table,
        crate={item.item_id: item for item in crate},
        training={item.item_id: item for item in training},
    )


def _make_hand(rig: Rig, target_force_n: float | None, damage: DamageModel | None) -> SortingHand:
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
