"""The panel of recordings: list, replay, rename, delete."""

from __future__ import annotations

import html
import os
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from nicegui import run, ui

from palpate.errors import InputError
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.folder import (
    GraspSummary,
    describe_damage,
    find_recording,
    is_simulated,
)
from palpate_station.dashboard.messages import Action, Play
from palpate_station.dashboard.panel_grasp import SPEEDS
from palpate_station.dashboard.panel_html import day_text
from palpate_station.dashboard.viewer import Viewer, add_heading, add_paragraph


def add_recordings_panel(
    app_state: AppState, viewer: Viewer, *, name: str | None = None
) -> Callable[[str], None]:
    """Fill the panel and open a recording, if named; return a function that opens one."""
    with ui.element("div").classes("form"):
        add_heading("Recordings")
        add_paragraph(
            f"Folder: {app_state.settings.folder}. A replay recomputes the grasp from the "
            "recorded raw counts."
        )
        speed = ui.toggle(SPEEDS, value=1.0).props("unelevated no-caps")
        speed.props["aria-label"] = "Replay speed"
        rows = ui.element("div").classes("w-full").props("id=recordings")
        empty_label = ui.label("No recordings yet. Each grasp creates one.").classes("muted")
        empty_label.set_visibility(False)
    shown: dict[Path, _Row] = {}
    dialog = _RecordingDialog(app_state, viewer, speed, changed=lambda: show())

    async def show() -> None:
        """Update the list without moving existing rows, which a user may be touching."""
        listed = await run.io_bound(_list_recordings, app_state)
        if listed is None or rows.is_deleted:  # the server is closing, or the viewer has left
            return
        for removed in shown.keys() - {one.file for one in listed}:
            shown.pop(removed).delete()
        with rows:
            for one in reversed(listed):
                if one.file not in shown:
                    shown[one.file] = _Row(one.file, viewer, speed, dialog)
                    shown[one.file].move(target_index=0)
                shown[one.file].show(one)
        empty_label.set_visibility(not listed)

    def open_recording(name: str) -> None:
        """Open the dialog of a recording, if it exists."""
        try:
            dialog.open(find_recording(app_state.settings.folder, name))
        except InputError as error:
            viewer.refuse(error)
            ui.navigate.history.replace("/recordings")

    ui.timer(2.0, show)
    if name is not None:
        open_recording(name)
    return open_recording


@dataclass(frozen=True, slots=True)
class _ListedRecording:
    """A recording of the list."""

    file: Path
    status: os.stat_result
    grasp: GraspSummary | None
    simulated: bool
    #: What is missing or damaged; empty for an intact recording.
    damage: str


def _list_recordings(app_state: AppState) -> list[_ListedRecording]:
    """Return the newest recordings; called in a thread, because a disk may be slow."""
    listed = []
    in_use = app_state.session.devices.files_in_use
    for file, status in app_state.recordings.newest():
        grasp = app_state.history.find_grasp(file.name)
        simulated = is_simulated(file, status) if grasp is None else grasp.simulated
        # A recording that is being written is not finished.
        damage = "" if file.name in in_use else describe_damage(file, status)
        listed.append(_ListedRecording(file, status, grasp, simulated, damage))
    return listed


class _Row(ui.element):
    """One recording with its buttons."""

    def __init__(
        self, file: Path, viewer: Viewer, speed: ui.toggle, dialog: _RecordingDialog
    ) -> None:
        super().__init__("div")
        self._file = file
        self.classes("file")
        with self:
            with ui.element("div").classes("what"):
                ui.label(file.stem)
                self._ended = ui.html("", sanitize=False)
                self._about = ui.label().classes("muted")
                self._damage = ui.label().classes("note")
            viewer.button(
                "Replay",
                lambda: viewer.order(Play(file=file, speed=speed.value)),
                small=True,
                action=Action.PLAY,
            )
            menu_button = ui.button(
                icon="more_vert", on_click=lambda: dialog.open(file), color=None
            )
            menu_button.classes("btn plain small").props("flat")
            menu_button.props["aria-label"] = f"More about {file.stem}"

    def show(self, one: _ListedRecording) -> None:
        """Show the grasp outcome, modification time, file size and damage."""
        grasp = one.grasp
        when = day_text(datetime.fromtimestamp(one.status.st_mtime))
        self._about.set_text(f"{when} · {one.status.st_size / 1024:.0f} kB")
        badge = "<span class='badge-sim'>SIMULATED</span>" if one.simulated else ""
        words = "" if grasp is None else grasp.outcome.replace("_", " ")
        item = f" <b>{html.escape(grasp.item_id)}</b>" if grasp and grasp.item_id else ""
        self._ended.set_content(f"{words}{item} {badge}")
        self._damage.set_text(one.damage)
        self._damage.set_visibility(bool(one.damage))


class _RecordingDialog:
    """The dialog to replay, download, rename or delete a recording, shared by all rows.

    While the dialog is open, the URL contains the recording.
    """

    def __init__(
        self,
        app_state: AppState,
        viewer: Viewer,
        speed: ui.toggle,
        *,
        changed: Callable[[], Awaitable[None]],
    ) -> None:
        self._app_state, self._viewer, self._changed = app_state, viewer, changed
        self._file, self._speed = Path(), speed
        with ui.dialog() as self._dialog, ui.card().classes("care"):
            self._dialog.props["aria-label"] = "Recording"
            viewer.button("Replay", self._replay, small=True, action=Action.PLAY)
            self._name = ui.input("Name").props("outlined dense maxlength=80").classes("w-full")
            self._question = ui.label().classes("note").props("role=status")
            with ui.element("div").classes("two"):
                viewer.button("Download", self._download, small=True)
                viewer.button("Rename", self._rename, small=True, action=Action.FILES)
                self._delete_button = viewer.button(
                    "Delete", self._delete, small=True, action=Action.FILES
                )
                viewer.button("Close", self._dialog.close, small=True)
        self._dialog.on_value_change(lambda event: self._update_address(is_open=event.value))

    def open(self, file: Path) -> None:
        """Open the dialog of a recording."""
        self._file = file
        self._name.set_value(file.stem)
        self._show_question("")
        self._dialog.open()

    def _update_address(self, *, is_open: bool) -> None:
        path = f"/recordings/{quote(self._file.name)}" if is_open else "/recordings"
        ui.navigate.history.replace(path)

    def _show_question(self, question: str) -> None:
        self._question.set_text(question)
        self._delete_button.set_text("Delete permanently" if question else "Delete")

    def _replay(self) -> None:
        self._dialog.close()
        self._viewer.order(Play(file=self._file, speed=self._speed.value))

    def _download(self) -> None:
        ui.download(f"/recordings/file/{quote(self._file.name)}")

    async def _rename(self) -> None:
        await self._run_and_close(
            lambda: self._app_state.rename(self._file.name, self._name.value or "")
        )

    async def _delete(self) -> None:
        if not self._question.text:
            self._show_question(f"Delete {self._file.stem}? This can't be undone.")
            return
        await self._run_and_close(lambda: self._app_state.delete(self._file.name))

    async def _run_and_close(self, function: Callable[[], object]) -> None:
        if self._viewer.run_action(Action.FILES, function):
            self._dialog.close()
            await self._changed()
