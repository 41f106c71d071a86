"""`palpate bruise ITEM`: is it bruised, how probable is that, on which pixels, and where."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from palpate.cli import options as option
from palpate.cli.items import open_store
from palpate.cli.options import JsonOption, StoreOption
from palpate.cli.output import print_json
from palpate.errors import InputError
from palpate.produce.bruise.items import ItemBruise, examine_item, learn_from
from palpate.produce.bruise.model import BruiseModel, default_model
from palpate.produce.store import Store
from palpate.terminal_table import print_table


def bruise(
    item: Annotated[
        str,
        typer.Argument(help="Which item; grasped before.", autocompletion=option.complete_items),
    ],
    store: StoreOption = None,
    learn: Annotated[
        bool,
        typer.Option(
            "--learn",
            help="Learn from the items of its kind that people called bruised or sound, instead "
            "of using the model that comes with palpate.",
        ),
    ] = False,
    model: Annotated[
        Path | None,
        typer.Option(help="Use a model that `palpate study bruise --out` wrote.", metavar="FILE"),
    ] = None,
    bruised_share: Annotated[
        float,
        typer.Option(
            help="Fraction of sides expected to be bruised before anything is measured.",
            min=0.0001,
            max=0.9999,
            metavar="FRACTION",
        ),
    ] = 0.5,
    as_json: JsonOption = False,
) -> None:
    """Judge whether an item is bruised, side by side, from its last visit.

    Each side is compared with its own earlier record, the item's other sides, and items of its kind
    that people called sound on the same rig (palpate items NAME --say bruise=sound), as far as
    there are any. The answer is kept with the item. Exits with 1 where it is bruised.

    Example: palpate bruise A17 --bruised-share 0.05
    """
    with open_store(store) as known:
        found = examine_item(
            known,
            item,
            model=_model(known, item, learn=learn, file=model),
            bruised_share=bruised_share,
            given_at=datetime.now(UTC),
        )
    if as_json:
        print_json(
            {
                "item_id": item,
                "bruised": found.bruised,
                "probability": found.probability,
                "before_percent": found.before_percent,
                "now_percent": found.now_percent,
                "bruised_pixels_percent": found.bruised_percent,
                "sides": [side.to_dict() for side in found.sides],
                "learned_on": found.model.learned_on,
                "explanation": found.explanation,
                "simulated": found.simulated,
            }
        )
    else:
        _print(item, found)
    if found.bruised:
        raise typer.Exit(1)


def _model(store: Store, item: str, *, learn: bool, file: Path | None) -> BruiseModel:
    if learn and file is not None:
        raise InputError(f"--learn and --model {file}: give one of them")
    if learn:
        kind = store.item(item).kind
        if kind is None:
            raise InputError(
                f"item {item!r} has no kind to learn about; palpate items {item} --set kind=apple"
            )
        return learn_from(store, kind=kind)
    return default_model() if file is None else BruiseModel.load(file)


def _print(item: str, found: ItemBruise) -> None:
    console = Console(highlight=False)
    verdict, note = "bruised" if found.bruised else "sound", " (simulated)" * found.simulated
    console.print(f"[bold]{escape(item)}: {verdict}[/bold]{note}")
    rows = [
        (
            f"{side.angle_deg:g}°",
            str(side.grasps),
            f"{100 * side.probability:.0f}",
            ", ".join(side.against),
            " or ".join(spot.in_words for spot in side.spots) * (side.probability >= 0.5),
        )
        for side in found.sides
    ]
    columns = (">side", ">grasps", ">bruised, %", "compared with", "where, if it is")
    print_table(columns, rows, console=console)
    changes = {
        "all pixels before": found.before_percent,
        "all pixels now": found.now_percent,
        "pixels on the bruise": found.bruised_percent,
    }
    known = [f"{name} {value:.1f} %" for name, value in changes.items() if value is not None]
    console.print(f"Mean relative change: {', '.join(known)}")
    console.print(f"[dim]Learned on {found.model.learned_on}.[/dim]")
