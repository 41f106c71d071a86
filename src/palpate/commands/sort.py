"""`palpate sort`: which bin each item goes to and why, or what one item of the store is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.options import (
    JsonOption,
    QuietOption,
    SeedOption,
    StoreOption,
    TargetForceOption,
)
from palpate.commands.progress import progress
from palpate.errors import InputError


def sort(
    rules: Annotated[
        Path | None, typer.Option(help="The rules, a TOML file.", metavar="FILE")
    ] = None,
    identify: Annotated[
        str | None,
        typer.Option(
            help="In place of sorting: report of which kind this item of the store is, and keep "
            "the answer with it. Exits with 1 if it is unknown.",
            metavar="ITEM",
            autocompletion=completion.items,
        ),
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(
            help="Grasp with this rig: sim-rigid brings a simulated crate, any other takes the "
            "names of items from standard input, one a line. Without it: items of the store, by "
            "the grasps they had; nothing is written.",
            metavar="NAME_OR_TOML",
        ),
    ] = None,
    damage: Annotated[
        Path | None,
        typer.Option(
            help="With --rig: press no item harder than produce like it bears; a file of "
            "`palpate calibrate damage`.",
            metavar="FILE",
        ),
    ] = None,
    target_force_n: TargetForceOption = None,
    store: StoreOption = None,
    batch: Annotated[
        str | None,
        typer.Option(help="Only items of this batch; with --rig, the batch that items come with."),
    ] = None,
    items: Annotated[int, typer.Option(help="Size of the simulated crate.", min=1)] = 12,
    taught: Annotated[
        int,
        typer.Option(
            help="Simulated items of each kind to teach, where the store is empty.", min=3
        ),
    ] = 6,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Sort items into bins by readable rules; report why, how purely and how fast.

    What is unsure is grasped again, as often as the rules allow. A firmer squeeze
    (--target-force-n) distinguishes better; --damage keeps it below what produce bears. With a
    rig, items, grasps and verdicts go to the store; a simulated crate goes there only with
    --store.

    Kinds are taught by labelled items: palpate items NAME --set kind=kiwi, three of a kind at
    least.

    Example: palpate sort --rules rules.toml --rig sim-rigid --items 12 --seed 1
    """
    from palpate.commands.sort_identify import identify as identify_item
    from palpate.commands.sort_report import SortReport
    from palpate.commands.sort_run import sort_from_store, sort_with_rig
    from palpate.commands.sort_supply import ItemSqueeze, SimulatedCrate, open_supply
    from palpate.estimate.damage_file import DamageFile
    from palpate.produce.sorting.rules_file import read_rules

    if identify is not None:
        unused: dict[str, object] = {"--rules": rules, "--rig": rig, "--batch": batch}
        unused |= {"--damage": damage, "--target-force-n": target_force_n}
        for option, given in unused.items():
            if given is not None:
                raise InputError(f"{option} {given}: --identify takes an item of the store alone")
        identify_item(identify, store=store, as_json=as_json)
        return
    if rules is None:
        raise InputError("name the --rules FILE to sort by, or the item with --identify ITEM")
    book = read_rules(rules)
    limit = None if damage is None else DamageFile.load(damage).model
    if rig is None:
        for name, value in (("--damage", damage), ("--target-force-n", target_force_n)):
            if value is not None:
                raise InputError(f"{name} {value}: nothing is grasped; name a --rig")
        report = SortReport(book=book, dry=True)
        sort_from_store(report, rules=rules, store=store, batch=batch)
    else:
        squeeze = ItemSqueeze(target_force_n=target_force_n, damage=limit)
        supply = open_supply(rig, seed=seed, items=items, taught=taught, squeeze=squeeze)
        # Over a real hand people are asked for items: a bar would be in the way.
        crate = isinstance(supply, SimulatedCrate)
        try:
            with progress("sorting", total=items, quiet=quiet or as_json or not crate) as show:
                report = SortReport(book=book, dry=False, show=show)
                sort_with_rig(report, supply, rules=rules, store=store, batch=batch)
        finally:
            supply.close()
    report.emit(as_json=as_json)
