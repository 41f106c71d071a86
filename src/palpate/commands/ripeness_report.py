"""Output of `palpate ripeness`: a table for people, one document for programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from palpate.produce.ripeness.items import FirmnessHistory, assumed, explanation
from palpate.produce.ripeness.rule import SURE, Days

if TYPE_CHECKING:
    from palpate.produce.records import Item
    from palpate.produce.ripeness.reference_object import Drift
    from palpate.produce.ripeness.rule import Ripeness, RipenessRule


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """One item with everything that is known of its ripeness."""

    item: Item
    history: FirmnessHistory
    ripeness: Ripeness
    rule: RipenessRule | None
    drift: Drift | None


def ripeness_document(judged: Sequence[Judged]) -> dict[str, object]:
    """Return the JSON form; a time that never comes is null."""
    return {
        "items": [
            {
                "item_id": one.item.item_id,
                "kind": one.item.kind,
                "simulated": _simulated(one.history),
                "drive": one.history.drive,
                "stage": one.ripeness.stage,
                "probabilities": one.ripeness.probabilities,
                "unsure": one.ripeness.unsure,
                "days_to_ripe": _days(one.ripeness.days_to_ripe),
                "basis": one.ripeness.basis,
                "explanation": explanation(one.ripeness, one.history),
                "days": _by_day(one.history),
                # Width: of the forces read; pressure: of how the load is shared.
                "reference_moved_percent": None
                if one.drift is None
                else 100 * math.expm1(one.drift.at(one.history.grasps[-1].taken_at)),
            }
            for one in judged
        ]
    }


def print_ripeness(judged: Sequence[Judged]) -> None:
    """Print one line for each item, and the days of a single one."""
    from rich.console import Console
    from rich.table import Table

    from palpate.commands.fitted_table import fitted

    console = Console(highlight=False)
    table = Table(box=None, header_style="dim")
    for column in ("item", "stage", "chance", "days to ripe", "felt"):
        table.add_column(column, no_wrap=column == "chance")
    for one in judged:
        chance = one.ripeness.probabilities[one.ripeness.stage]
        days = len(one.history.days)
        table.add_row(
            one.item.item_id,
            f"[bold]{one.ripeness.stage}[/]",
            "assumed" if assumed(one.ripeness, one.history) else f"{100 * chance:.0f} %",
            _waiting(one.ripeness.days_to_ripe),
            f"{len(one.history.grasps)} times on {days} day{'s' * (days > 1)}",
        )
    console.print(fitted(table, console=console))
    if len(judged) == 1:
        console.print(f"\n{explanation(judged[0].ripeness, judged[0].history)}")
        console.print(_days_table(judged[0].history))
    unsure = [
        one.item.item_id
        for one in judged
        if one.ripeness.unsure and not assumed(one.ripeness, one.history)
    ]
    if unsure:
        console.print(
            f"less than {100 * SURE:.0f} % sure: {', '.join(unsure)}; "
            "more grasps on the same day help"
        )
    for advice in dict.fromkeys(one.drift.advice for one in judged if one.drift is not None):
        if advice:
            console.print(f"[yellow]! {advice}[/]")
    if any(_simulated(one.history) for one in judged):
        console.print("[bold yellow]SIMULATED[/]: these grasps were made on the twin")


def _days_table(history: FirmnessHistory) -> object:
    from rich.table import Table

    width = history.drive == "width"
    table = Table(box=None, header_style="dim")
    for column in ("day", "stiffness, N/mm" if width else "pixels sharing", "settled, %", "grasps"):
        table.add_column(column, justify="right")
    for row in _by_day(history):
        felt = row["stiffness_n_per_mm"] if width else row["pixels_sharing"]
        settled = row["settled_percent"]
        table.add_row(
            f"{row['day']:.1f}",
            f"{felt:.2f}",
            "-" if settled is None else f"{settled:.1f}",
            str(row["grasps"]),
        )
    return table


def _by_day(history: FirmnessHistory) -> list[dict[str, float | int | None]]:
    rows: list[dict[str, float | int | None]] = []
    width = history.drive == "width"
    for number, day in enumerate(history.days):
        settled = [
            grasp.measurements["settled_percent"].middle
            for grasp in history.grasps
            if "settled_percent" in grasp.measurements
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


def _simulated(history: FirmnessHistory) -> bool:
    return any(grasp.simulated for grasp in history.grasps)


def _days(days: Days | None) -> dict[str, float | None] | None:
    if days is None:
        return None
    ends = {"value": days.value, "low": days.low, "high": days.high}
    return {name: end if math.isfinite(end) else None for name, end in ends.items()}


def _waiting(days: Days | None) -> str:
    if days is None:
        return "not known without labels"
    if days.high <= 0:
        return "ripe, or past it"
    ends = [_day(end) for end in _ends(days)]
    return f"{ends[0]} ({ends[1]} to {ends[2]})"


def _day(end: float) -> str:
    if math.isinf(end):
        return "never"
    return f"{end:.1f}" if end >= 0.05 else "now"


def _ends(days: Days) -> tuple[float, float, float]:
    return days.value, days.low, days.high
