"""The panel of items: what each was like, grasp after grasp."""

from __future__ import annotations

import html
from collections.abc import Sequence

from nicegui import run, ui

from palpate.dashboard.desk import Desk
from palpate.dashboard.ledger import ItemPage, Past
from palpate.dashboard.pressing import Hands
from palpate.errors import PalpateError

_WIDTH, _HEIGHT, _LEFT, _FOOT, _TOP = 360, 170, 40, 26, 12


def items_panel(desk: Desk, hands: Hands) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        ui.html("<h3>Items and how they ripen</h3>", sanitize=False)
        choice = ui.select([], on_change=lambda event: show(event.value)).classes("w-full")
        choice.props('outlined dense use-input clearable label="Item"')
        box = ui.html("", sanitize=False).props("id=item-page")

    async def show(item_id: str | None) -> None:
        if not item_id:
            box.set_content("")
            return
        try:
            found = await run.io_bound(desk.ledger.page, item_id)
        except PalpateError as error:
            box.set_content(f"<p class='note'>{html.escape(str(error))}</p>")
            return
        if found is not None:  # None while the server ends
            box.set_content(item_html(found))

    async def look() -> None:
        try:
            names = await run.io_bound(desk.ledger.items) or []
        except PalpateError as error:
            desk.ledger.trouble = str(error)
            return
        if names != choice.options:
            choice.set_options(names, value=choice.value)
        if desk.ledger.trouble:
            box.set_content(f"<p class='note'>{html.escape(desk.ledger.trouble)}</p>")
        elif not names:
            box.set_content("<p>None yet: name an item on the page Set up, and grasp it.</p>")
        elif choice.value:
            await show(choice.value)

    ui.timer(3.0, look)


def item_html(item: ItemPage) -> str:
    """Return an item's page: what it is, its stiffness over time, and what was said of it."""
    what = ", ".join(part for part in (item.kind, item.batch) if part)
    simulated = any(past.simulated for past in item.stiffness + item.settled)
    said = "".join(
        f"<tr><td class='num'>{when:%d %b %H:%M}</td><td>{html.escape(about)}</td>"
        f"<td><b>{html.escape(text)}</b> {html.escape(why)}</td></tr>"
        for when, about, text, why in item.verdicts
    )
    badge = "<span class='badge-sim'>SIMULATED</span>" if simulated else ""
    return (
        f"<p class='said'>{html.escape(item.item_id)} {badge}</p>"
        f"<p>{html.escape(what)}{', ' if what else ''}{item.grasps} "
        f"grasp{'s' if item.grasps != 1 else ''}</p>"
        + _chart("Stiffness, N/mm", item.stiffness)
        + _chart("Settled change, %", item.settled)
        + (f"<h3>What was said</h3><table class='plain'>{said}</table>" if said else "")
    )


def _chart(title: str, past: Sequence[Past]) -> str:
    """Return values with their intervals over time as an SVG picture."""
    if not past:
        return ""
    times = [one.taken_at.timestamp() for one in past]
    low, high = min(one.low for one in past), max(one.high for one in past)
    span, length = (high - low) or 1.0, (times[-1] - times[0]) or 1.0
    single = len(past) == 1

    def x(time: float) -> float:
        share = 0.5 if single else (time - times[0]) / length
        return _LEFT + 10 + share * (_WIDTH - _LEFT - 24)

    def y(value: float) -> float:
        return _TOP + (high - value) / span * (_HEIGHT - _TOP - _FOOT - 6)

    marks = "".join(
        f"<line x1='{x(t):.1f}' x2='{x(t):.1f}' y1='{y(one.low):.1f}' y2='{y(one.high):.1f}' "
        "stroke='var(--accent)' stroke-width='2' opacity='.45'/>"
        f"<circle cx='{x(t):.1f}' cy='{y(one.value):.1f}' r='4.5' fill='var(--accent)'/>"
        for t, one in zip(times, past, strict=True)
    )
    path = " ".join(f"{x(t):.1f},{y(one.value):.1f}" for t, one in zip(times, past, strict=True))
    scale = "".join(
        f"<text class='soft' x='{_LEFT - 4}' y='{y(value) + 4:.1f}' text-anchor='end' "
        f"font-size='11'>{value:.3g}</text>"
        for value in (low, high)
    )
    ends = [past[0]] if single else [past[0], past[-1]]
    days = "".join(
        f"<text class='soft' x='{x(one.taken_at.timestamp()):.1f}' y='{_HEIGHT - 6}' "
        f"text-anchor='{anchor}' font-size='11'>{one.taken_at:%d %b %H:%M}</text>"
        for one, anchor in zip(ends, ["middle"] if single else ["start", "end"], strict=True)
    )
    return (
        f"<h3>{title}</h3><svg viewBox='0 0 {_WIDTH} {_HEIGHT}' style='width:100%' role='img' "
        f"aria-label='{title} over time'><line x1='{_LEFT}' x2='{_WIDTH - 8}' "
        f"y1='{_HEIGHT - _FOOT}' y2='{_HEIGHT - _FOOT}' stroke='var(--line)'/>"
        f"<polyline points='{path}' fill='none' stroke='var(--accent)' stroke-dasharray='3 4'/>"
        f"{marks}{scale}{days}</svg>"
    )
