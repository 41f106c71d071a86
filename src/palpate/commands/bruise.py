"""`palpate bruise ITEM`: is it bruised, how sure is that, on which pixels, and where."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.commands import completion
from palpate.commands.options import JsonOption, StoreOption

if TYPE_CHECKING:
    from palpate.produce.bruise.items import ItemBruise
    from palpate.produce.bruise.judge import SideVerdict
    from palpate.produce.bruise.model import BruiseModel
    from palpate.produce.store import Store


def bruise(
    item: Annotated[
        str, typer.Argument(help="Which item; grasped before.", autocompletion=completion.items)
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
            help="Share of sides expected to be bruised before anything is felt.",
            min=0.0001,
            max=0.9999,
        ),
    ] = 0.5,
    as_json: JsonOption = False,
) -> None:
    """Judge whether an item is bruised, side by side, from its last visit.

    Each side is compared with its own earlier record, the item's other sides, and items of its kind
    that people called sound on the same rig (palpate items NAME --say bruise=sound): whatever there
    is of these. The answer is kept with the item. Exits with 1 where it is bruised.

    Example: palpate bruise A17 --bruised-share 0.05
    """
    from palpate.commands.items import opened
    from palpate.produce.bruise.items import examine_item

    with opened(store) as kept:
        found = examine_item(
            kept,
            item,
            model=_model(kept, item, learn=learn, file=model),
            bruised_share=bruised_share,
            given_at=datetime.now(UTC),
        )
    if as_json:
        print(json.dumps(_document(item, found), allow_nan=False, indent=1))
    else:
        _show(item, found)
    if found.bruised:
        raise typer.Exit(1)


def _model(store: Store, item: str, *, learn: bool, file: Path | None) -> BruiseModel:
    from palpate.errors import InputError
    from palpate.produce.bruise.items import learn_from
    from palpate.produce.bruise.model import BruiseModel, default_model

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


def _document(item: str, found: ItemBruise) -> dict[str, Any]:
    return {
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


def _show(item: str, found: ItemBruise) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    note = " (simulated)" if found.simulated else ""
    verdict = "bruised" if found.bruised else "sound"
    console.print(f"[bold]{escape(str(item))}: {verdict}[/bold]{note}", highlight=False)
    table = Table(box=None, header_style="dim")
    for column in ("side", "grasps", "bruised, %"):
        table.add_column(column, justify="right")
    table.add_column("compared with")
    table.add_column("where, if it is")
    for side in found.sides:
        table.add_row(
            f"{side.angle_deg:g}°",
            str(side.grasps),
            f"{100 * side.probability:.0f}",
            ", ".join(side.against),
            _where(side),
        )
    console.print(table)
    columns = {
        "all pixels before": found.before_percent,
        "all pixels now": found.now_percent,
        "pixels on the bruise": found.bruised_percent,
    }
    console.print(
        "Mean relative change: "
        + ", ".join(
            f"{name} {value:.1f} %" for name, value in columns.items() if value is not None
        ),
        highlight=False,
    )
    console.print(f"[dim]Learned on {found.model.learned_on}.[/dim]", highlight=False)


def _where(side: SideVerdict) -> str:
    if side.probability < 0.5:
        return ""
    return " or ".join(spot.in_words for spot in side.spots)
