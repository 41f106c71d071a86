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
        none = ui.label("None yet: every grasp leaves one here.").classes("muted")
    shown: dict[Path, _Row] = {}

    def show() -> None:
        """Bring the list up to date, and leave every row that stays where a finger may be on it."""
        files = dict(desk.recordings()[:_MOST])
        for gone in shown.keys() - files.keys():
            shown.pop(gone).delete()
        with rows:
            for file, status in reversed(files.items()):
                if file not in shown:
                    shown[file] = _Row(file, hands, speed)
                    shown[file].move(target_index=0)
                shown[file].say(status)
        none.set_visibility(not files)

    show()
    ui.timer(2.0, show)


class _Row(ui.element):
    """One recording with its button."""

    def __init__(self, file: Path, hands: Hands, speed: ui.toggle) -> None:
        super().__init__("div")
        self.classes("file")
        with self:
            with ui.element("div").classes("what"):
                ui.label(file.stem)
                self._about = ui.label().classes("muted")
            button = ui.button("Replay", color=None)
            button.on_click(lambda: hands.order(Play(file=file, speed=speed.value)))
            button.classes("btn plain small").props("flat no-caps")
            hands.gate(button, Action.PLAY)

    def say(self, status: os.stat_result) -> None:
        """Say when it was written last, and how long it is."""
        when = datetime.fromtimestamp(status.st_mtime).strftime("%d %b %H:%M")
        self._about.set_text(f"{when} · {status.st_size / 1024:.0f} kB")
