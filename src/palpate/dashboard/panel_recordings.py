"""The panel of recordings: what there is, and replaying it."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path

from nicegui import ui

from palpate.dashboard.desk import Desk
from palpate.dashboard.messages import Play
from palpate.dashboard.panel_grasp import SPEEDS
from palpate.dashboard.pressing import Hands
from palpate.dashboard.session import Action

_MOST = 100


def recordings_panel(desk: Desk, hands: Hands) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        ui.html("<h3>Recordings</h3>", sanitize=False)
        ui.html(
            f"<p>In {desk.settings.folder}. A replay decides the recorded grasp again from its raw "
            "counts.</p>",
            sanitize=False,
        )
        speed = ui.toggle(SPEEDS, value=1.0).props('unelevated no-caps aria-label="Replay speed"')
        rows = ui.element("div").classes("w-full").props("id=recordings")
    shown: list[tuple[tuple[Path, os.stat_result], ...] | None] = [None]

    def show() -> None:
        files = tuple(desk.recordings()[:_MOST])
        if files == shown[0]:
            return
        shown[0] = files
        rows.clear()
        with rows:
            if not files:
                ui.label("None yet: every grasp leaves one here.").classes("muted")
            for file, told in files:
                _row(file, told, hands, speed)

    show()
    ui.timer(2.0, show)


def _row(file: Path, told: os.stat_result, hands: Hands, speed: ui.toggle) -> None:
    when = datetime.fromtimestamp(told.st_mtime).strftime("%d %b %H:%M")
    with ui.element("div").classes("file"):
        with ui.element("div").classes("what"):
            ui.label(file.stem)
            ui.label(f"{when} · {told.st_size / 1024:.0f} kB").classes("muted")
        button = ui.button(
            "Replay", on_click=lambda: hands.order(Play(file=file, speed=speed.value)), color=None
        )
        button.classes("btn plain small").props("flat no-caps")
        hands.gate(button, Action.PLAY)
