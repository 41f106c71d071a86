"""`palpate ripeness`: what days of grasps show of an item, and when it will be ripe."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.commands import completion
from palpate.commands.options import DpiOption, JsonOption, StoreOption
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.commands.ripeness_report import Judged
    from palpate.produce.records import Drive, Item
    from palpate.produce.ripeness.reference_object import Drift
    from palpate.produce.ripeness.rule import RipenessRule
    from palpate.produce.store import Store

_DEFAULT_STAGES = "hard,conditioned,ripe,overripe"


def ripeness(
    items: Annotated[
        list[str] | None,
        typer.Argument(
            help="Which items; grasped before.", metavar="ITEM", autocompletion=completion.items
        ),
    ] = None,
    batch: Annotated[str | None, typer.Option(help="All items of this batch.")] = None,
    store: StoreOption = None,
    reference: Annotated[
        str | None,
        typer.Option(
            help="Item that never changes (a rubber ball), grasped on each day: it "
            "separates drift of the sensor from softening.",
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
    dpi: DpiOption = None,
    as_json: JsonOption = False,
) -> None:
    """Report how ripe items are and when they will be ripe, from their grasps so far.

    Stages are learned from items of the same kind that people labelled (palpate items NAME
    --set kind=avocado --say ripeness=ripe); without labels an item is judged by its own first
    day, taken as hard. The answer is kept with the item, unless it is no more than that assumption.

    Example: palpate ripeness A17 --reference ball --plot a17.png
    """
    from palpate.commands.items import opened
    from palpate.commands.ripeness_report import print_ripeness, ripeness_document
    from palpate.plots.style import check_plot
    from palpate.produce.ripeness.items import assumed, verdict_of

    names = _names(stages, ripe=ripe)
    check_plot(plot, dpi=dpi)
    with opened(store) as kept:
        asked = _asked(kept, items or [], batch=batch)
        if plot is not None and len(asked) != 1:
            raise InputError(f"--plot {plot}: draws one item; {len(asked)} were asked for")
        judge = _Judge(kept, reference=reference, stages=names, ripe=ripe)
        judged = [judge.judged(item) for item in asked]
        for one in judged:
            if assumed(one.ripeness, one.history):
                continue
            kept.add_verdict(verdict_of(one.ripeness, one.history))
    if plot is not None:
        from palpate.plots.ripeness import item_figure
        from palpate.plots.style import save_figure

        figure = item_figure(judged[0].history, judged[0].ripeness, rule=judged[0].rule)
        save_figure(figure, plot, dpi=dpi)
    if as_json:
        print(json.dumps(ripeness_document(judged), allow_nan=False, indent=1))
    else:
        print_ripeness(judged)
        if plot is not None:
            print(f"Written: {plot}")


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


class _Judge:
    """Rules and drifts learned from the store, once for each kind and gripper."""

    def __init__(
        self, store: Store, *, reference: str | None, stages: tuple[str, ...], ripe: str
    ) -> None:
        self._store, self._reference = store, reference
        self._stages, self._ripe = stages, ripe
        self._drifts: dict[Drive, Drift | None] = {}
        self._rules: dict[tuple[str, Drive], RipenessRule | InputError] = {}

    def judged(self, item: Item) -> Judged:
        """Judge one item by what it was taught on the same kind of fingers."""
        from palpate.commands.ripeness_report import Judged
        from palpate.produce.identify.items import drive_of
        from palpate.produce.ripeness.items import history_of, judge_ripeness

        grasps = self._store.grasps_of(item.item_id)
        drive = drive_of(grasps, item_id=item.item_id)
        drift = self._drift(drive)
        history = history_of(grasps, item_id=item.item_id, drive=drive, drift=drift)
        rule = self._rule(item, drive)
        return Judged(
            item=item,
            history=history,
            ripeness=judge_ripeness(history, rule=rule, ripe=self._ripe),
            rule=rule,
            drift=drift,
        )

    def _drift(self, drive: Drive) -> Drift | None:
        from palpate.produce.ripeness.items import drift_of

        if drive not in self._drifts:
            self._drifts[drive] = (
                None
                if self._reference is None
                else drift_of(self._store, self._reference, drive=drive)
            )
        return self._drifts[drive]

    def _rule(self, item: Item, drive: Drive) -> RipenessRule | None:
        """Return what labels teach of its kind; None where its own first day must do."""
        if item.kind is None:
            found: RipenessRule | InputError = InputError(
                f"its kind is not known (palpate items {item.item_id} --set kind=...)"
            )
        else:
            key = (item.kind, drive)
            if key not in self._rules:
                self._rules[key] = self._learned(*key)
            found = self._rules[key]
        if not isinstance(found, InputError):
            return found
        if drive == "pressure" or self._stages != tuple(_DEFAULT_STAGES.split(",")):
            raise found
        print(f"palpate ripeness: {item.item_id} by its own first day: {found}", file=sys.stderr)
        return None

    def _learned(self, kind: str, drive: Drive) -> RipenessRule | InputError:
        from palpate.produce.ripeness.items import learn_rule

        try:
            return learn_rule(
                self._store, kind=kind, drive=drive, stages=self._stages, drift=self._drift(drive)
            )
        except InputError as why:
            return why
