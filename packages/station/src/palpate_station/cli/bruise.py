"""`palpate bruise ITEM`: bruise verdict with probability and pixels."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated

import typer
from rich.markup import escape

from palpate.cli.options import JsonOption, StoreOption, opt
from palpate.cli.output import print_json
from palpate.errors import InputError
from palpate.terminal_table import make_console, print_table
from palpate_station.bruise.examination import ItemBruise, examine_item, learn_bruise_model
from palpate_station.bruise.model import BruiseModel, default_model
from palpate_station.cli.items import open_store
from palpate_station.cli.options import ItemArgument
from palpate_station.store import Store


def bruise(
    item: ItemArgument,
    store: StoreOption = None,
    learn: Annotated[
        bool,
        opt(
            "--learn",
            "Learn from items of the same kind that people labelled bruised or sound, instead "
            "of the built-in simulated sides.",
        ),
    ] = False,
    bruised_fraction: Annotated[
        float,
        opt(
            "--bruised-share FRACTION",
            "Prior probability that a side is bruised.",
            min=0.0001,
            max=0.9999,
        ),
    ] = 0.5,
    as_json: JsonOption = False,
) -> None:
    """Judge whether an item is bruised, from the grasps of its last visit.

    Each side is compared with its own earlier grasps if there are any. Otherwise it is compared
    with items of the same kind labelled sound on the same rig (palpate items NAME --say
    bruise=sound), or with the item's other sides. The verdict is stored. Exit status 1: bruised.

    Example: palpate bruise A17 --bruised-share 0.05
    """
    with open_store(store) as opened:
        found = examine_item(
            opened,
            item,
            model=_learn(opened, item) if learn else default_model(),
            bruised_fraction=bruised_fraction,
            given_at=datetime.now(UTC),
        )
    if as_json:
        print_json(
            {
                "item_id": item,
                "bruised": found.is_bruised,
                "probability": found.probability,
                "before_percent": found.before_percent,
                "now_percent": found.sides[0].mean_percent,
                "bruised_pixels_percent": found.sides[0].pixels_percent,
                "sides": [asdict(side) for side in found.sides],
                "learned_on": found.model.learned_on,
                "explanation": found.explanation,
                "simulated": found.simulated,
            }
        )
    else:
        _print(item, found)
    if found.is_bruised:
        raise typer.Exit(1)


def _learn(store: Store, item: str) -> BruiseModel:
    kind = store.item(item).kind
    if kind is None:
        raise InputError(
            f"item {item!r} has no kind; set it: palpate items {item} --set kind=apple"
        )
    return learn_bruise_model(store, kind=kind)


def _print(item: str, found: ItemBruise) -> None:
    console = make_console()
    verdict, note = "bruised" if found.is_bruised else "sound", " (simulated)" * found.simulated
    console.print(f"[bold]{escape(item)}: {verdict}[/bold]{note}")
    rows = [
        (
            f"{side.angle_deg:g}°",
            str(side.grasps),
            f"{100 * side.probability:.0f}",
            side.against,
            # Rows and columns are numbered from 1.
            ", ".join(f"{row + 1}/{column + 1}" for row, column in side.pixels)
            if side.probability >= 0.5
            else "",
        )
        for side in found.sides
    ]
    columns = (">side", ">grasps", ">bruised, %", "compared with", "pixels, if bruised")
    print_table(columns, rows, console=console)
    changes = {
        "all pixels before": found.before_percent,
        "all pixels now": found.sides[0].mean_percent,
        "pixels that may be on the bruise": found.sides[0].pixels_percent,
    }
    known = [f"{name} {value:.1f} %" for name, value in changes.items() if value is not None]
    console.print(f"Mean relative change: {', '.join(known)}")
    console.print(f"[dim]Learned on {found.model.learned_on}.[/dim]")
