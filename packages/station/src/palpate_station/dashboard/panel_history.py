"""The panels of past grasps: items with their history, and the current run."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from functools import partial
from urllib.parse import quote

from markupsafe import Markup
from nicegui import run, ui

from palpate.errors import PalpateError
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.folder import LISTED_GRASPS, Entry, History
from palpate_station.dashboard.item_store import error_text
from palpate_station.dashboard.panel_html import day_text, panel_html
from palpate_station.dashboard.viewer import Viewer, add_heading
from palpate_station.store.item_history import ItemHistory, item_facts

#: Maximum number of items in the list; any other item can be found by its name.
_MAX_ITEMS = 50


def add_items_panel(
    app_state: AppState, viewer: Viewer, *, item_id: str | None = None
) -> Callable[[str], None]:
    """Fill the panel, optionally with an item; return a function that shows items."""
    with ui.element("div").classes("form"):
        add_heading("Items and their ripening")
        options = {item_id: item_id} if item_id else {}
        choice = ui.select(options, value=item_id, on_change=lambda event: choose(event.value))
        choice.classes("w-full")
        choice.props("outlined dense use-input clearable behavior=dialog")
        choice.props["label"] = "Item"
        box = ui.html("", sanitize=False).props("id=item-page")
    #: Figures of the shown item, with its name and its number of grasps and verdicts.
    figures, drawn = [""], [("", 0, 0)]

    async def choose(item_id: str | None) -> None:
        """Show an item and put it into the URL."""
        if not item_id:
            box.set_content("")
            return
        ui.navigate.history.replace(f"/items/{quote(item_id, safe='')}")
        await show(item_id)

    async def show(item_id: str) -> None:
        """Read an item from the store and show it."""
        try:
            found = await run.io_bound(app_state.item_store.page, item_id)
            if found is None or box.is_deleted:  # the server is closing, or the viewer has left
                return
            version = (item_id, len(found.grasps), len(found.verdicts))
            if version != drawn[0]:
                if item_id != drawn[0][0]:
                    # The first figures of an item take seconds.
                    box.set_content(item_html(found))
                figures[0] = await run.io_bound(app_state.item_store.figures_html, found) or ""
                drawn[0] = version
        except PalpateError as error:
            box.set_content(f"<p class='note'>{html.escape(error_text(error))}</p>")
            return
        if not box.is_deleted:
            box.set_content(item_html(found, figures=figures[0]))

    async def refresh_items() -> None:
        """Read the items and the shown item from the store again."""
        try:
            pages = await run.io_bound(partial(app_state.item_store.pages, limit=_MAX_ITEMS))
        except PalpateError as error:
            app_state.item_store.trouble = error_text(error)
            return
        if box.is_deleted:
            return
        names = {page.item.item_id: item_label(page) for page in pages or ()}
        if choice.value:
            names = {choice.value: choice.value} | names
        if names != choice.options:
            choice.set_options(names, value=choice.value)
        if app_state.item_store.trouble:
            box.set_content(f"<p class='note'>{html.escape(app_state.item_store.trouble)}</p>")
        elif not names:
            hint = "No items yet. Name an item on the tab Set up and grasp it."
            box.set_content(f"<p>{hint}</p>")
        elif choice.value:
            await show(choice.value)

    def open_item(item_id: str) -> None:
        """Select an item, which may be missing in the list."""
        options = choice.options if isinstance(choice.options, dict) else {}
        choice.set_options({item_id: item_id} | options, value=item_id)

    ui.timer(3.0, refresh_items)
    return open_item


def item_label(page: ItemHistory) -> str:
    """Return the list text of an item: name, kind, stage and last grasp."""
    facts = item_facts(page.item.item_id, kind=page.item.kind, verdicts=page.verdicts)
    last = day_text(page.grasps[-1].taken_at) if page.grasps else ""
    words = (page.item.item_id, facts.kind, facts.stage, last)
    return " · ".join(str(word) for word in words if word)


def item_html(page: ItemHistory, *, figures: str = "") -> str:
    """Return an item as HTML: facts, figures and verdicts."""
    return panel_html("item", page=page, figures=Markup(figures))


_CURVE_WIDTH, _CURVE_HEIGHT = 96, 30


def add_run_panel(app_state: AppState, viewer: Viewer) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        add_heading("This run")
        counts = ui.html("", sanitize=False).props("id=run-counts")
        add_heading(f"Last {LISTED_GRASPS} grasps")
        with ui.element("div").classes("file"):
            ui.label("Stored in the folder of the recordings.").classes("what muted")
            ui.link("Save as CSV", "/grasps.csv").classes("pill").props("id=run-csv download")
        rows = ui.html("", sanitize=False).classes("w-full").props("id=run")

    def show(version: int) -> None:
        """Update the counts and the list."""
        counts.set_content(
            counts_html(app_state.history, rules=app_state.settings.rules is not None)
        )
        listed = [entry_html(entry) for entry in app_state.history.recent_grasps]
        rows.set_content("".join(listed) or "<p>No grasps yet.</p>")

    viewer.on_change(lambda: app_state.history.version, show)


def counts_html(history: History, *, rules: bool) -> str:
    """Return the number of this run's grasps by outcome and by bin as HTML."""
    return panel_html("counts", history=history, rules=rules)


def entry_html(entry: Entry) -> str:
    """Return one entry of the list as HTML."""
    return panel_html("entry", entry=entry, points=_points(entry.curve))


def _points(values: Sequence[float]) -> str:
    """Return a curve as SVG polyline points; empty for an empty curve."""
    if not values:
        return ""
    low, span = min(values), (max(values) - min(values)) or 1.0
    return " ".join(
        f"{2 + i * (_CURVE_WIDTH - 4) / (len(values) - 1):.1f},"
        f"{2 + (1 - (value - low) / span) * (_CURVE_HEIGHT - 4):.1f}"
        for i, value in enumerate(values)
    )
