"""The two ways of sorting: items that the store holds, and items before a hand."""

from __future__ import annotations

import sys
from collections.abc import Collection
from contextlib import nullcontext
from datetime import datetime
from functools import partial
from pathlib import Path

from palpate.cli.items import open_store
from palpate.cli.sort_report import SortReport
from palpate.cli.sort_supply import SimulatedCrate, Supply
from palpate.errors import DeviceError, InputError
from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import Identifier
from palpate.produce.identify.items import identity_verdict, learn_kinds, touches_of
from palpate.produce.records import Item, Verdict
from palpate.produce.sorting.hand import TimedGrasp
from palpate.produce.sorting.rules import RuleBook, decide
from palpate.produce.sorting.rules_file import check_kinds
from palpate.produce.sorting.run import Sorted, bin_verdict, evidence_of, sort_item
from palpate.produce.store import Store

#: Grasps of each labelled item: two show how far grasps of one item differ.
_TAUGHT_GRASPS = 2
_BROKEN = {"sensor_lost": "the sensor was lost", "gripper_fault": "the gripper failed"}


def sort_from_store(
    report: SortReport, *, rules: Path, store: str | None, batch: str | None
) -> None:
    """Decide on items of the store by the grasps and verdicts that they have.

    Raises `InputError` if there is no such batch, or no item with a grasp.
    """
    with open_store(store) as kept:
        asked = kept.items() if batch is None else kept.of_batch(batch)
        found = [(item, kept.grasps_of(item.item_id)) for item in asked]
        found = [(item, grasps) for item, grasps in found if grasps]
        if not found:
            which = "the store" if batch is None else f"batch {batch!r}"
            raise InputError(f"{which} holds no item that was grasped; grasp some, or name a --rig")
        labelled = {item.kind for item, _ in found if item.kind is not None}
        guess = any(item.kind is None for item, _ in found)
        identifier = _learn_kinds(kept, report.book, rules=rules, labelled=labelled, guess=guess)
        for item, grasps in found:
            verdicts = kept.verdicts_of(item.item_id)
            evidence = evidence_of(grasps, identifier=identifier, kind=item.kind, verdicts=verdicts)
            done = Sorted(
                item_id=item.item_id,
                decision=decide(report.book, evidence),
                identity=evidence.identity,
                size_mm=evidence.size_mm,
                grasps=tuple(grasps),
                grasping_s=0.0,
            )
            report.add(done, belongs=None)


def sort_with_rig(
    report: SortReport, supply: Supply, *, rules: Path, store: str | None, batch: str | None
) -> None:
    """Grasp what comes and decide; keep all of it where there is a store.

    Raises `InputError` if the rules ask for what this hand can't measure, or kinds were not taught;
    `DeviceError` if a device fails.
    """
    simulated = isinstance(supply, SimulatedCrate)
    _check_measurable(report.book, supply, rules=rules)
    with nullcontext() if simulated and store is None else Store.open(store) as kept:
        identifier = None
        if report.book.asks("class"):
            if isinstance(supply, SimulatedCrate) and (kept is None or not kept.items(limit=1)):
                identifier = _teach(supply, kept)
                check_kinds(report.book, taught=identifier.kinds, path=rules)
            elif kept is not None:
                identifier = _learn_kinds(kept, report.book, rules=rules)
        for name in supply.names():
            kind: str | None = None
            verdicts: tuple[Verdict, ...] = ()
            if kept is not None:
                kept.add_item(Item(item_id=name, batch=batch))
                kind, verdicts = kept.item(name).kind, kept.verdicts_of(name)
            done = sort_item(
                name,
                book=report.book,
                identifier=identifier,
                grasp=partial(_grasp_and_store, name, supply, kept),
                kind=kind,
                verdicts=verdicts,
            )
            if kept is not None:
                _store_verdicts(done, kept, now=supply.hand.now())
            report.add(done, belongs=supply.belongs(name, book=report.book))
        if kept is not None and (waiting := kept.send_or_explain()):
            print(f"palpate: {waiting}", file=sys.stderr)


def _learn_kinds(
    kept: Store,
    book: RuleBook,
    *,
    rules: Path,
    labelled: Collection[str] = (),
    guess: bool = True,
) -> Identifier | None:
    """Learn from the store what the rules ask for, where there is anything to guess."""
    if not book.asks("class"):
        return None
    identifier = learn_kinds(kept) if guess else None
    taught = () if identifier is None else identifier.kinds
    check_kinds(book, taught={*taught, *labelled}, path=rules)
    return identifier


def _check_measurable(book: RuleBook, supply: Supply, *, rules: Path) -> None:
    """Refuse rules that fingers driven by pressure can never decide."""
    if supply.hand.plan.gripper.drive == "width":
        return
    for rule in book.rules:
        if rule.asks("class") or rule.asks("size_mm"):
            raise InputError(
                f"rules file {rules} line {rule.line}: asks for class or size, and fingers driven "
                "by pressure measure neither size nor stiffness; use fingers driven by width"
            )


def _teach(supply: SimulatedCrate, kept: Store | None) -> Identifier:
    """Grasp labelled items of each kind, so that there is something to go by."""
    count = len(supply.teaching)
    print(f"teaching with {count} labelled items (simulated) ...", file=sys.stderr)
    found = []
    for item in supply.iterate_labelled():
        timed: list[TimedGrasp] = []
        for turn in range(_TAUGHT_GRASPS):
            size = timed[-1].grasp.measurements.get("size_mm") if timed else None
            timed.append(_grasp(item.item_id, supply, turn=turn, size=size))
        grasps = [one.grasp for one in timed]
        if kept is not None:
            kept.add_item(item)
            kept.add_grasps(grasps, calibration=supply.calibration)
        found.append((str(item.kind), touches_of(grasps)))
    return Identifier(found)


def _grasp_and_store(
    name: str, supply: Supply, kept: Store | None, turn: int, size: Measurement | None
) -> TimedGrasp:
    """Grasp an item and store the grasp before the next one, which may fail."""
    timed = _grasp(name, supply, turn=turn, size=size)
    if kept is not None:
        kept.add_grasp(timed.grasp, calibration=supply.calibration)
    return timed


def _store_verdicts(done: Sorted, kept: Store, *, now: datetime) -> None:
    if done.identity is not None and done.identity.grasps:
        kept.add_verdict(identity_verdict(done.item_id, done.identity, given_at=now))
    kept.add_verdict(bin_verdict(done, given_at=now))


def _grasp(name: str, supply: Supply, *, turn: int, size: Measurement | None) -> TimedGrasp:
    """Lay an item and grasp it; equipment that fails, or a person who stops it, ends it all."""
    supply.lay(name, turn=turn)
    timed = supply.hand.grasp(name, expected=size)
    outcome = str(timed.grasp.outcome)
    if outcome == "stopped":
        raise KeyboardInterrupt
    if outcome in _BROKEN:
        raise DeviceError(f"while grasping {name} {_BROKEN[outcome]}; run `palpate doctor`")
    return timed
