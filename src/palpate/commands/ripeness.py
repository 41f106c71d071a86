"""`palpate ripeness`: what days of grasps say of an item, and when it will be ripe."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.commands.store_option import STORE_HELP
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.produce.records import Item
    from palpate.produce.reference_object import Drift
    from palpate.produce.ripeness import Ripeness, RipenessRule
    from palpate.produce.ripeness_store import ItemHistory
    from palpate.produce.store import Store

_DEFAULT_STAGES = "hard,conditioned,ripe,overripe"


def ripeness(
    items: Annotated[
        list[str] | None, typer.Argument(help="Which items; grasped before.", metavar="[ITEM]...")
    ] = None,
    batch: Annotated[str | None, typer.Option(help="All items of this batch.")] = None,
    store: Annotated[
        str | None, typer.Option(help=STORE_HELP, metavar="FILE_OR_URL", show_default=False)
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            help="Item that never changes (a rubber ball), grasped on each day: drift of the "
            "sensor is told from softening by it.",
            metavar="ITEM",
        ),
    ] = None,
    stages: Annotated[
        str, typer.Option(help="Stages as people label them, firmest first.", metavar="A,B,...")
    ] = _DEFAULT_STAGES,
    ripe: Annotated[str, typer.Option(help="The stage that is waited for.")] = "ripe",
    plot: Annotated[
        Path | None, typer.Option(help="Draw the days of one item.", metavar="FILE")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Say how ripe items are and when they will be, by their grasps so far.

    Stages are learned from items of the same kind that people labelled (palpate items NAME
    --set kind=avocado --say ripeness=ripe); without labels an item is judged by its own first
    day. The answer is kept with the item.

    Example: palpate ripeness A17 --reference ball --plot a17.png
    """
    from palpate.commands.ripeness_report import document, print_report
    from palpate.plots.style import check_plot_path, require_plots
    from palpate.produce.ripeness_store import verdict_of
    from palpate.produce.store import Store

    names = _names(stages, ripe=ripe)
    if plot is not None:
        check_plot_path(plot)
        require_plots()
    with Store.open(store, create=False) as kept:
        asked = _asked(kept, items or [], batch=batch)
        if plot is not None and len(asked) != 1:
            raise InputError(f"--plot {plot}: draws one item; {len(asked)} were asked for")
        judged = [
            _judged(kept, item, reference=reference, stages=names, ripe=ripe) for item in asked
        ]
        for one in judged:
            kept.add_verdict(verdict_of(one.ripeness, one.history))
    if plot is not None:
        from palpate.plots.ripeness import item_figure
        from palpate.plots.style import save_figure

        figure = item_figure(judged[0].history, judged[0].ripeness, rule=judged[0].rule)
        save_figure(figure, plot)
    if as_json:
        print(json.dumps(document(judged), allow_nan=False, indent=1))
    else:
        print_report(judged)


class Judged:
    """One item with all that is said of it."""

    def __init__(
        self,
        item: Item,
        *,
        history: ItemHistory,
        ripeness: Ripeness,
        rule: RipenessRule | None,
        drift: Drift | None,
    ) -> None:
        self.item, self.history, self.ripeness = item, history, ripeness
        self.rule, self.drift = rule, drift


def _names(stages: str, *, ripe: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in stages.split(","))
    if len(names) < 2 or len(set(names)) < len(names) or not all(names):
        raise InputError(f"--stages {stages}: name at least two different stages, firmest first")
    if ripe not in names[1:]:
        raise InputError(f"--ripe {ripe}: must be one of {', '.join(names[1:])}")
    return names


def _asked(store: Store, items: list[str], *, batch: str | None) -> list[Item]:
    found = [store.item(item) for item in items]
    if batch is not None:
        of_batch = store.of_batch(batch)
        if not of_batch:
            raise InputError(f"--batch {batch}: no item of this batch in {store.name}")
        found += [item for item in of_batch if item.item_id not in items]
    if not found:
        raise InputError("name an item, or --batch; `palpate items` lists them")
    return found


def _judged(
    store: Store, item: Item, *, reference: str | None, stages: tuple[str, ...], ripe: str
) -> Judged:
    from palpate.produce.identify_store import drive_of
    from palpate.produce.ripeness_store import drift_of, history_of, judge, learn_rule

    grasps = store.grasps_of(item.item_id)
    drive = drive_of(grasps, item_id=item.item_id)
    drift = None if reference is None else drift_of(store, reference, drive=drive)
    history = history_of(grasps, item_id=item.item_id, drive=drive, drift=drift)
    rule = None
    try:
        if item.kind is None:
            raise InputError(
                f"nobody said what it is (palpate items {item.item_id} --set kind=...)"
            )
        rule = learn_rule(store, kind=item.kind, drive=drive, stages=stages, drift=drift)
    except InputError as why:
        if drive == "pressure" or stages != tuple(_DEFAULT_STAGES.split(",")):
            raise
        print(f"palpate ripeness: {item.item_id} by its own first day: {why}", file=sys.stderr)
    return Judged(
        item,
        history=history,
        ripeness=judge(history, rule=rule, ripe=ripe),
        rule=rule,
        drift=drift,
    )
