"""The panel of the run: how the last grasps ended, how many, and into which bins."""

from __future__ import annotations

import html
from collections import Counter
from datetime import datetime
from urllib.parse import quote

from nicegui import ui

from palpate.dashboard.app_state import AppState
from palpate.dashboard.history import LISTED, Entry, History
from palpate.dashboard.html_parts import day_text, heading
from palpate.dashboard.panel_recordings import recording_address
from palpate.dashboard.viewer import Viewer
from palpate.grasp.result import Outcome

_WIDTH, _HEIGHT = 96, 30
_WORDS = {outcome: str(outcome).replace("_", " ") for outcome in Outcome}


def run_panel(app_state: AppState, viewer: Viewer) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        heading("This run")
        counts = ui.html("", sanitize=False).props("id=run-counts")
        heading(f"Last {LISTED} grasps")
        with ui.element("div").classes("file"):
            ui.label("Kept in the folder of the recordings.").classes("what muted")
            ui.link("Save as CSV", "/grasps.csv").classes("pill").props("id=run-csv download")
        rows = ui.html("", sanitize=False).classes("w-full").props("id=run")
    shown = [-1]

    def show() -> None:
        """Show the run again when a grasp was added."""
        if app_state.history.version == shown[0]:
            return
        shown[0] = app_state.history.version
        counts.set_content(
            counts_html(app_state.history, rules=app_state.settings.rules is not None)
        )
        listed = [entry_html(entry) for entry in app_state.history.recent]
        rows.set_content("".join(listed) or "<p>None yet.</p>")

    viewer.on_refresh(show)


def counts_html(history: History, *, rules: bool) -> str:
    """Return how the grasps of this run ended, and where they went."""
    since = history.since.astimezone().strftime("%H:%M")
    ended = _counts({_WORDS[Outcome(name)]: n for name, n in history.outcomes.items()})
    total = history.outcomes.total()
    many = f"<b>{total}</b> grasp{'' if total == 1 else 's'} since {since}"
    total_line = f"<p class='num'>{many}{ended}</p>"
    if not rules:
        return total_line
    bins = "".join(
        f"<tr><td>{html.escape(name)}</td><td class='r num'>{n}</td></tr>"
        for name, n in history.bins.most_common()
    )
    if not bins:
        return f"{total_line}<p>No named item was sorted yet.</p>"
    head = "<tr><th>bin</th><th class='r'>grasps</th></tr>"
    return f"{total_line}<table class='plain' id='run-bins'>{head}{bins}</table>"


def _counts(counted: dict[str, int]) -> str:
    parts = [f"{n} {name}" for name, n in Counter(counted).most_common()]
    return f": {', '.join(parts)}" if parts else ""


def entry_html(entry: Entry) -> str:
    """Return one line of the list."""
    when = day_text(datetime.fromisoformat(entry.ended_at).astimezone())
    item, name = html.escape(entry.item_id), quote(entry.item_id, safe="")
    link = f"<a href='/items/{name}' data-item='{item}'>{item}</a>"
    called = link if item else "no name"
    found_to_be = "the object was damaged" if entry.damaged else (entry.firmness or "")
    ended = _WORDS[Outcome(entry.outcome)], found_to_be
    words = html.escape(": ".join(filter(None, ended)))
    found = f"<b>{html.escape(entry.bin)}</b>" if entry.bin else ""
    found += " for now" if entry.again else ""
    badge = "<span class='badge-sim'>SIMULATED</span>" if entry.simulated else ""
    file = html.escape(entry.recording)
    address = recording_address(entry.recording)
    replay = f" · <a href='{address}' data-recording='{file}'>recording</a>" if file else ""
    return (
        f"<div class='ran' data-kind='{entry.kind}' title='{html.escape(entry.why or '')}'>"
        f"<div class='what'><div>{called} {badge}</div><div>{words}</div>"
        f"<div class='muted num'>{when}{replay}</div></div><div class='where'>{found}"
        f"{sparkline(entry)}</div></div>"
    )


def sparkline(entry: Entry) -> str:
    """Return a small curve of the grasp; nothing where it was too short to draw."""
    values = entry.curve
    if not values:
        return ""
    low, span = min(values), (max(values) - min(values)) or 1.0
    points = " ".join(
        f"{2 + i * (_WIDTH - 4) / (len(values) - 1):.1f},"
        f"{2 + (1 - (value - low) / span) * (_HEIGHT - 4):.1f}"
        for i, value in enumerate(values)
    )
    label = f"Course of the grasp, {min(values):g} to {max(values):g}"
    return (
        f"<svg viewBox='0 0 {_WIDTH} {_HEIGHT}' width='{_WIDTH}' height='{_HEIGHT}' role='img' "
        f"aria-label='{label}'><polyline points='{points}' fill='none' stroke='var(--curve)' "
        "stroke-width='1.5'/></svg>"
    )
