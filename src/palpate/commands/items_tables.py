"""Items as a person reads them in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from palpate.commands.fitted_table import fitted
from palpate.estimate.measurement import Measurement
from palpate.produce.records import About, Source
from palpate.produce.store.item_history import ItemHistory

#: Grasps and verdicts shown on a page: the last ones.
_SHOWN = 20
_SIMULATED = "[yellow]~[/]"
#: Characters of each line that a page's frame takes.
_FRAME = 6


def print_list(pages: Sequence[ItemHistory], *, more: bool) -> None:
    """Print one line per item."""
    console = Console(highlight=False)
    if not pages:
        console.print("no items; `palpate grasp --item NAME` adds one")
        return
    table = _table(
        "item",
        "kind",
        "batch",
        "last grasp",
        ">grasps",
        ">size, mm",
        ">firmness",
        ">N/mm",
        "verdict",
    )
    for page in pages:
        size, stiffness = page.latest("size_mm"), page.latest("stiffness_n_per_mm")
        latest = [one for about in About if (one := page.latest_verdict(about)) is not None]
        table.add_row(
            Text(page.item.item_id, style="bold"),
            Text(page.item.kind or "-"),
            Text(page.item.batch or "-"),
            _when(page.grasps[-1].taken_at) if page.grasps else "-",
            f"{len(page.grasps)}{f' {_SIMULATED}' if page.simulated else '  '}",
            _value(size, 1),
            _value(page.latest("firmness"), 0),
            _value(stiffness, 2),
            Text(", ".join(one.text for one in latest) or "-"),
        )
    console.print(fitted(table, console=console))
    if any(page.simulated for page in pages):
        console.print(f"{_SIMULATED} simulated on the twin", style="dim")
    if more:
        console.print(f"the last {len(pages)} items; --limit shows more", style="dim")


def print_page(page: ItemHistory) -> None:
    """Print everything that is known of one item."""
    item = page.item
    known = (item.kind, item.batch and f"batch {item.batch}", item.label)
    seen = f"first seen {_when(item.first_seen)}" if item.first_seen is not None else None
    facts = "  ·  ".join(filter(None, (*known, seen)))
    console = Console(highlight=False)
    parts: list[RenderableType] = [Text(facts)]
    for table in [_grasps(page)] * bool(page.grasps) + [_verdicts(page)] * bool(page.verdicts):
        parts += [Text(""), fitted(table, console=console, taken=_FRAME)]
    if not page.grasps:
        parts.append(Text(f"not grasped yet: palpate grasp --item {item.item_id!r}", style="dim"))
    subtitle = "[bold yellow]SIMULATED on the twin[/]" if page.simulated else None
    title = Text(item.item_id, style="bold")
    console.print(
        Panel(Group(*parts), title=title, subtitle=subtitle, padding=(1, 2), expand=False)
    )


def _grasps(page: ItemHistory) -> Table:
    columns = (
        ">size\nmm",
        ">force\nN",
        ">firmness\n",
        ">stiffness\nN/mm",
        ">settled\n%",
        ">side\n",
    )
    table = _table("taken", "outcome", *columns)
    for grasp in page.grasps[-_SHOWN:]:
        measured = grasp.measurements
        table.add_row(
            _when(grasp.taken_at),
            str(grasp.outcome),
            _band(measured.get("size_mm"), 1),
            _band(measured.get("force_n"), 2),
            _band(measured.get("firmness"), 0),
            _band(measured.get("stiffness_n_per_mm"), 2),
            _band(measured.get("settled_percent"), 1),
            "-" if grasp.angle_deg is None else f"{grasp.angle_deg:g}°",
        )
    if len(page.grasps) > _SHOWN:
        table.caption = f"the last {_SHOWN} of {len(page.grasps)} grasps; --json has all"
    return table


def _verdicts(page: ItemHistory) -> Table:
    table = _table("given", "about", "verdict", ">sure", "why")
    for one in page.verdicts[-_SHOWN:]:
        person = one.source is Source.PERSON
        table.add_row(
            _when(one.given_at),
            str(one.about),
            Text(one.text, style="bold"),
            "-" if one.probability is None else f"{100 * one.probability:.0f} %",
            Text("given by a person" if person and not one.explanation else one.explanation),
        )
    return table


def _table(*columns: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), show_edge=False, header_style="dim")
    for column in columns:
        right = column.startswith(">")
        table.add_column(
            column.lstrip(">"),
            justify="right" if right else "left",
            overflow="fold",
        )
    return table


def _when(moment: datetime) -> str:
    return moment.astimezone().strftime("%Y-%m-%d %H:%M")


def _value(measured: Measurement | None, digits: int) -> str:
    return "-" if measured is None else measured.text(digits=digits)


def _band(measured: Measurement | None, digits: int) -> str:
    if measured is None:
        return "-"
    low, high = f"{measured.low:.{digits}f}", f"{measured.high:.{digits}f}"
    return f"[bold]{measured.text(digits=digits)}[/]\n[dim]{low}…{high}[/]"
