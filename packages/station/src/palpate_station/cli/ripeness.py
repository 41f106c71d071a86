"""`palpate ripeness`: stage and days to ripe, from grasps on several days."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Annotated

import numpy as np
import typer
from rich.text import Text

from palpate.cli import options as option
from palpate.cli.options import JsonOption, StoreOption, opt
from palpate.cli.output import finite_or_none, format_percent, print_json, print_message
from palpate.errors import InputError
from palpate.plots.style import check_plot, save_figure
from palpate.terminal_table import make_console, print_table
from palpate_station.cli.items import find_batch, open_store
from palpate_station.cli.options import BatchOption, complete_items
from palpate_station.records import Item
from palpate_station.ripeness.history import (
    FirmnessHistory,
    explain_stage,
    firmness_history,
    is_assumed,
    judge_ripeness,
    last_drive,
    learn_rule,
    make_ripeness_verdict,
)
from palpate_station.ripeness.rule import CONFIDENT_PROBABILITY, Days, Ripeness, RipenessRule
from palpate_station.store import Store

_DEFAULT_STAGES = "hard,conditioned,ripe,overripe"


def ripeness(
    items: Annotated[
        list[str] | None,
        typer.Argument(
            help="Previously grasped items.",
            metavar="ITEM",
            autocompletion=complete_items,
        ),
    ] = None,
    batch: BatchOption = None,
    store: StoreOption = None,
    stages: Annotated[
        str, opt("--stages A,B,...", "Labelled stages, firmest first.")
    ] = _DEFAULT_STAGES,
    ripe: Annotated[str, opt("--ripe STAGE", "Stage that counts as ripe.")] = "ripe",
    plot: option.PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Report how ripe items are and when they will be ripe.

    Stages are learned from labelled items of the same kind (palpate items NAME --set kind=avocado
    --say ripeness=ripe). Without labels, the item is assumed to be hard on its first day. The
    verdict is stored unless it is based on this assumption alone.

    Example: palpate ripeness A17 --plot a17.png
    """
    names = _stage_names(stages, ripe=ripe)
    check_plot(plot)
    with open_store(store) as opened:
        asked = _select_items(opened, items or [], batch=batch)
        if plot is not None and len(asked) != 1:
            raise InputError(f"--plot {plot}: plots a single item, but {len(asked)} were given")
        judge = _Judge(opened, stages=names, ripe=ripe)
        judged = [judge.judge(item) for item in asked]
        for one in judged:
            if not one.is_assumed:
                opened.add_verdict(make_ripeness_verdict(one.ripeness, one.history))
    if plot is not None:
        from palpate_station.plots.ripeness import item_figure

        figure = item_figure(judged[0].history, judged[0].ripeness, rule=judged[0].rule)
        save_figure(figure, plot)
    if as_json:
        print_json({"items": [one.to_dict() for one in judged]})
    else:
        _print(judged)
        if plot is not None:
            print(f"Written: {plot}")


def _stage_names(stages: str, *, ripe: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in stages.split(","))
    if len(names) < 2 or len(set(names)) < len(names) or not all(names):
        raise InputError(f"--stages {stages}: give at least two different stages, firmest first")
    if ripe not in names[1:]:
        raise InputError(f"--ripe {ripe}: must be a stage after the first: {', '.join(names[1:])}")
    return names


def _select_items(store: Store, items: list[str], *, batch: str | None) -> list[Item]:
    found = [store.item(item) for item in items]
    if batch is not None:
        found += [item for item in find_batch(store, batch) if item.item_id not in items]
    if not found:
        raise InputError("give an item or --batch NAME; `palpate items` lists the items")
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Judged:
    """One item with its ripeness."""

    item: Item
    history: FirmnessHistory
    ripeness: Ripeness
    rule: RipenessRule | None

    @property
    def is_assumed(self) -> bool:
        return is_assumed(self.ripeness, self.history)

    @property
    def is_simulated(self) -> bool:
        return any(grasp.is_simulated for grasp in self.history.grasps)

    def to_dict(self) -> dict[str, object]:
        """Return the JSON form, with null for times of stages that are never reached."""
        history, found = self.history, self.ripeness
        return {
            "item_id": self.item.item_id,
            "kind": self.item.kind,
            "simulated": self.is_simulated,
            "drive": history.drive,
            "stage": found.stage,
            "probabilities": found.probabilities,
            "unsure": found.is_uncertain,
            "days_to_ripe": _days_document(found.days_to_ripe),
            "basis": found.basis,
            "explanation": explain_stage(found, history),
            "days": _day_rows(history),
        }


class _Judge:
    """Judges items with rules learned once for each kind and gripper drive."""

    def __init__(self, store: Store, *, stages: tuple[str, ...], ripe: str) -> None:
        self._store, self._stages, self._ripe = store, stages, ripe
        self._rule_of = cache(partial(learn_rule, store, stages=stages))

    def judge(self, item: Item) -> _Judged:
        """Judge one item with the rule of its kind and gripper drive."""
        grasps = self._store.grasps_of(item.item_id)
        drive = last_drive(grasps, item_id=item.item_id)
        history = firmness_history(grasps, item_id=item.item_id, drive=drive)
        try:
            if item.kind is None:
                raise InputError(
                    f"its kind is unknown; set it with palpate items {item.item_id} --set kind=..."
                )
            rule: RipenessRule | None = self._rule_of(kind=item.kind, drive=drive)
        except InputError as why:
            if drive == "pressure" or self._stages != tuple(_DEFAULT_STAGES.split(",")):
                raise
            print_message(
                f"palpate ripeness: {item.item_id}: judged relative to its first day, because {why}"
            )
            rule = None
        return _Judged(
            item=item,
            history=history,
            ripeness=judge_ripeness(history, rule=rule, ripe=self._ripe),
            rule=rule,
        )


def _print(judged: Sequence[_Judged]) -> None:
    """Print one row per item and, for a single item, its days."""
    console = make_console()
    rows = [
        (
            Text(one.item.item_id),
            Text(one.ripeness.stage, style="bold"),
            "assumed"
            if one.is_assumed
            else format_percent(one.ripeness.probabilities[one.ripeness.stage]),
            "unknown without labels" if (days := one.ripeness.days_to_ripe) is None else days.text,
            f"{len(one.history.grasps)} on {len(one.history.days)} day"
            f"{'s' * (len(one.history.days) != 1)}",
        )
        for one in judged
    ]
    columns = ("item", "stage", ">probability", "days to ripe", "grasps")
    print_table(columns, rows, console=console)
    if len(judged) == 1:
        history = judged[0].history
        console.print(f"\n{explain_stage(judged[0].ripeness, history)}", markup=False)
        width = history.drive == "width"
        quantity_key = "stiffness_n_per_mm" if width else "pixels_sharing"
        day_rows = [
            (
                f"{row['day']:.1f}",
                f"{row[quantity_key]:.2f}",
                "-" if row["settled_percent"] is None else f"{row['settled_percent']:.1f}",
                str(row["grasps"]),
            )
            for row in _day_rows(history)
        ]
        quantity = ">stiffness, N/mm" if width else ">pixels sharing"
        print_table((">day", quantity, ">settled, %", ">grasps"), day_rows, console=console)
    uncertain = [
        one.item.item_id for one in judged if one.ripeness.is_uncertain and not one.is_assumed
    ]
    if uncertain:
        console.print(
            f"below {format_percent(CONFIDENT_PROBABILITY)} probability: {', '.join(uncertain)}; "
            "more grasps on the same day reduce the uncertainty",
            markup=False,
        )
    if any(one.is_simulated for one in judged):
        console.print("[bold yellow]SIMULATED[/]: grasps on the twin")


def _day_rows(history: FirmnessHistory) -> list[dict[str, float | int | None]]:
    rows: list[dict[str, float | int | None]] = []
    width = history.drive == "width"
    for number, day in enumerate(history.days):
        settled = [
            found.middle
            for grasp in history.grasps
            if (found := grasp.find_value("settled_percent")) is not None
            and history.nearest_day(grasp.taken_at) == number
        ]
        rows.append(
            {
                "day": day.day,
                "stiffness_n_per_mm": math.exp(day.firmness) if width else None,
                "pixels_sharing": None if width else math.exp(-day.firmness),
                "settled_percent": float(np.mean(settled)) if settled else None,
                "grasps": day.grasps,
            }
        )
    return rows


def _days_document(days: Days | None) -> dict[str, float | None] | None:
    if days is None:
        return None
    return {end: finite_or_none(getattr(days, end)) for end in ("value", "low", "high")}
