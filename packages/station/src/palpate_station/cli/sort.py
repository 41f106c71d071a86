"""`palpate sort`: sort items into bins, or identify the kind of one item."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from palpate.cli.options import (
    DamageOption,
    JsonOption,
    QuietOption,
    SeedOption,
    StoreOption,
    TargetForceOption,
    opt,
    refuse_options,
)
from palpate.cli.output import print_json, progress
from palpate.errors import InputError
from palpate.object.damage_file import DamageFile
from palpate.terminal_table import make_console, print_table
from palpate_station.cli.items import open_store
from palpate_station.cli.options import BatchOption, complete_items
from palpate_station.cli.sort_report import SortReport
from palpate_station.cli.sort_run import SimulatedCrate, open_supply, sort_from_store, sort_with_rig
from palpate_station.identify.identifier import Identifier, Identity
from palpate_station.identify.kinds import identity_verdict, item_features, learn_kinds
from palpate_station.learning import FALSE_REJECT, UNKNOWN
from palpate_station.sorting.rules_file import read_rules


def sort(
    rules: Annotated[Path | None, opt("--rules FILE", "The rules, a TOML file.")] = None,
    identify: Annotated[
        str | None,
        opt(
            "--identify ITEM",
            "Instead of sorting: identify the kind of this stored item, and store the "
            "verdict. Exit status 1: unknown kind.",
            autocompletion=complete_items,
        ),
    ] = None,
    rig: Annotated[
        str | None,
        opt(
            "--rig NAME_OR_TOML",
            "Grasp with this rig. sim-rigid has a simulated crate; other rigs read item "
            "names from standard input, one per line. Without --rig: a dry run with the stored "
            "grasps, which writes nothing.",
        ),
    ] = None,
    damage: DamageOption = None,
    target_force_n: TargetForceOption = None,
    store: StoreOption = None,
    batch: BatchOption = None,
    items: Annotated[int, opt("--items N", "Size of the simulated crate.", min=1)] = 12,
    training_items: Annotated[
        int,
        opt("--taught N", "Labelled simulated items of each kind, if the store is empty.", min=3),
    ] = 6,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Sort items into bins by readable rules, or identify one item.

    Uncertain items are grasped again, up to the number of grasps in the rules. A higher force
    (--target-force-n) separates kinds better; --damage limits the force. With a rig, items, grasps
    and verdicts are stored; a simulated crate is stored only with --store.

    Kinds are learned from at least three labelled items each: palpate items NAME --set kind=kiwi.

    Example: palpate sort --rules rules.toml --rig sim-rigid --items 12 --seed 1
    """
    grasping: dict[str, object] = {"--damage": damage, "--target-force-n": target_force_n}
    if identify is not None:
        refuse_options(
            {"--rules": rules, "--rig": rig, "--batch": batch, **grasping},
            why="can't be combined with --identify",
        )
        _identify(identify, store=store, as_json=as_json)
        return
    if rules is None:
        raise InputError(
            "give the sorting rules with --rules FILE, or an item with --identify ITEM"
        )
    book = read_rules(rules)
    limit = None if damage is None else DamageFile.load(damage).model
    if rig is None:
        refuse_options(grasping, why="requires --rig, because nothing is grasped without a rig")
        report = SortReport(book=book, dry=True)
        sort_from_store(report, rules=rules, store=store, batch=batch)
    else:
        supply = open_supply(
            rig,
            seed=seed,
            items=items,
            training_items=training_items,
            target_force_n=target_force_n,
            damage=limit,
        )
        # Without a crate the command prompts for items, so it shows no progress bar.
        is_prompting = not isinstance(supply, SimulatedCrate)
        try:
            with progress("sorting", total=items, quiet=quiet or as_json or is_prompting) as show:
                report = SortReport(book=book, dry=False, show=show)
                sort_with_rig(report, supply, rules=rules, store=store, batch=batch)
        finally:
            supply.close()
    report.emit(as_json=as_json)


def _identify(item: str, *, store: str | None, as_json: bool) -> None:
    """Identify an item from size and stiffness and store the verdict; exit 1 if unknown.

    Raises `InputError` if no grasp of the item measured both, or too few items are labelled.
    """
    with open_store(store) as opened:
        opened.item(item)
        grasps = opened.grasps_of(item)
        if not grasps:
            raise InputError(f"item {item!r} was never grasped; grasp it first")
        touches = item_features(grasps)
        if not touches:
            raise InputError(
                f"item {item!r}: no grasp measured size and stiffness; grasp the item again with "
                "fingers driven by width"
            )
        known = learn_kinds(opened, without=item)
        identity = known.identify(touches)
        verdict = identity_verdict(item, identity, given_at=datetime.now(UTC))
        opened.add_verdict(verdict)
    simulated = any(grasp.is_simulated for grasp in grasps)
    if as_json:
        print_json(
            {
                "item_id": item,
                "kind": identity.kind,
                "confidence": identity.confidence,
                "rejected": identity.rejected,
                "usual": identity.usual,
                "probability": dict(identity.probability),
                "grasps": identity.grasps,
                "explanation": verdict.explanation,
                "simulated": simulated,
            }
        )
    else:
        _print_identity(item, identity, known, why=verdict.explanation, simulated=simulated)
    if identity.rejected:
        raise typer.Exit(1)


def _print_identity(
    item: str, identity: Identity, known: Identifier, *, why: str, simulated: bool
) -> None:
    console = make_console()
    confidence = "" if identity.rejected else f" with {100 * identity.confidence:.0f} %"
    title = escape(f"{item}: {identity.kind}{confidence}")
    console.print(f"[bold]{title}[/bold]{' (simulated)' * simulated}")
    rows = [
        ("something else" if kind == UNKNOWN else escape(kind), f"{100 * probability:.1f}")
        for kind, probability in sorted(identity.probability.items(), key=lambda pair: -pair[1])
    ]
    print_table(("kind", ">probability, %"), rows, console=console)
    console.print(why, markup=False)
    if known.learner.items_missing:
        console.print(
            f"To detect unknown kinds at a false-rejection rate of {100 * FALSE_REJECT:g} %, label "
            f"{known.learner.items_missing} more items."
        )
