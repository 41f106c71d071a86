"""Build the pages: status header, plots on the stage, controls in the panel."""

from __future__ import annotations

import json
from pathlib import Path
from urllib.parse import unquote

from nicegui import Client, ui
from nicegui.events import GenericEventArguments

from palpate.plots.pixel_colors import DEEPEST_PERCENT, FALL, RISE, css_gradient
from palpate_station.dashboard.access import LOGOUT
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.messages import Confirm, Pause, Seek, SetSpeed
from palpate_station.dashboard.panel_grasp import (
    add_bin_correction,
    add_grasp_buttons,
    add_item_field,
    add_set_up_panel,
)
from palpate_station.dashboard.panel_history import add_items_panel, add_run_panel
from palpate_station.dashboard.panel_recordings import add_recordings_panel
from palpate_station.dashboard.panel_sensor import add_calibrate_panel, add_doctor_panel
from palpate_station.dashboard.users import Role, User
from palpate_station.dashboard.viewer import Viewer

_STATIC = Path(__file__).parent / "static"
#: Names of the tabs and their URL paths.
TABS = {
    "Set up": "/",
    "Calibrate": "/calibrate",
    "Doctor": "/doctor",
    "Recordings": "/recordings",
    "Items": "/items",
    "Run": "/run",
}
#: Colour map of the pixels, for the page's scripts and the legend.
_PIXEL_COLORS = (
    f"<style>:root {{ --change-map: {css_gradient()} }}</style>"
    '<script id="pixel-colors" type="application/json">'
    + json.dumps({"fall": FALL, "rise": RISE, "deepest_percent": DEEPEST_PERCENT})
    + "</script>"
)
#: The plotting library uPlot (MIT); its licence file is in the same folder.
_UPLOT = (
    '<link rel="stylesheet" href="/static/uplot/uPlot.min.css">'
    '<script src="/static/uplot/uPlot.iife.min.js"></script>'
)
_REFRESH_S = 0.2
_PREFERS_DARK = "(prefers-color-scheme: dark)"


def build_page(
    app_state: AppState,
    client: Client,
    *,
    tab: str,
    item_id: str | None = None,
    recording: str | None = None,
) -> None:
    """Build a viewer's page, opened at a tab of `TABS`, an item or a recording."""
    viewer = _start_page(app_state, client, script="live.js")
    _add_header(app_state, viewer, other=("/operate", "Operate"))
    ui.on("seek", lambda event: viewer.request(Seek(event.args)))
    ui.on("pause", lambda event: viewer.request(Pause(bool(event.args))))
    ui.on("confirm", lambda: viewer.request(Confirm()))
    ui.on("speed", lambda event: viewer.request(SetSpeed(event.args)))
    with ui.element("div").classes("page"):
        _add_static_html("stage.html", viewer, classes="stage")
        with ui.element("aside").classes("card panel"):
            _add_panel(app_state, viewer, tab=tab, item_id=item_id, recording=recording)
    ui.timer(_REFRESH_S, viewer.refresh)


def build_operator_page(app_state: AppState, client: Client) -> None:
    """Build the operator's page: verdict, next step, force and three buttons."""
    viewer = _start_page(app_state, client, script="operate.js")
    ui.query("body").classes("operate")
    _add_header(app_state, viewer, other=("/", viewer.words("button.full")), sound=True)
    with ui.element("div").classes("operator"):
        _add_static_html("operate.html", viewer)
        with ui.element("div").classes("item") as item:
            add_item_field(
                app_state,
                viewer,
                label=viewer.words("item.next"),
                label_again=viewer.words("item.returned"),
            )
        viewer.show_with_gripper(item)
        add_bin_correction(app_state, viewer)
    add_grasp_buttons(app_state, viewer)
    ui.timer(_REFRESH_S, viewer.refresh)


def _start_page(app_state: AppState, client: Client, *, script: str) -> Viewer:
    """Add the parts common to all pages; join the session when the browser connects."""
    ui.add_head_html('<link rel="stylesheet" href="/static/dashboard.css">')
    ui.add_head_html(_PIXEL_COLORS)
    session = app_state.session
    texts = json.dumps(dict(session.words.texts)).replace("<", "\\u003c")
    ui.add_head_html(f'<script id="words" type="application/json">{texts}</script>')
    if script == "live.js":
        ui.add_head_html(_UPLOT)
    # Outside of the framework's element tree, so the framework never moves or removes it.
    ui.add_body_html(session.words.fill((_STATIC / "stop.html").read_text(encoding="utf-8")))
    ui.add_body_html(f'<script type="module" src="/static/{script}"></script>')
    # Joined only when the browser has connected: a client that merely fetches the page must not
    # become the driver.
    user: User | None = client.request.scope.get("palpate_user")
    kind = "screen.full" if script == "live.js" else "screen.operate"
    name = (user and user.name) or session.words(kind, address=client.ip or "")
    role = Role.CONFIGURE if user is None else user.role
    client.on_connect(lambda: session.join(client.id, tab=client.tab_id, name=name, role=role))

    def mark_away() -> None:
        """Note a closed page, but not the end of an old connection of a page with a new one."""
        if not client.has_socket_connection:
            session.mark_away(client.id)

    client.on_disconnect(mark_away)
    client.on_delete(lambda: session.leave(client.id))
    may_drive = str(role.may_drive).lower()
    ui.query("body").props(f"data-viewer={client.id} data-may-drive={may_drive}")
    viewer = Viewer(session, viewer_id=client.id, user_name=(user and user.name) or "")
    ui.on("press", lambda event: viewer.record_press(event.args))
    ui.on("stop_failed", lambda: session.devices.add_alarm(session.words("stop.alarm")))
    return viewer


def _add_static_html(name: str, viewer: Viewer, *, classes: str = "contents") -> None:
    """Add a static HTML file, whose elements the page's scripts fill."""
    html = viewer.words.fill((_STATIC / name).read_text(encoding="utf-8"))
    ui.html(html, sanitize=False).classes(classes)


def _add_header(
    app_state: AppState, viewer: Viewer, *, other: tuple[str, str], sound: bool = False
) -> None:
    dark, words = ui.dark_mode(None), viewer.words

    async def toggle_dark() -> None:
        """Switch between light and dark; the browser's preference is the default."""
        is_dark = dark.value
        if is_dark is None:
            is_dark = await ui.run_javascript(f"matchMedia('{_PREFERS_DARK}').matches")
        dark.set_value(not is_dark)

    with ui.element("header").classes("bar"):
        _add_static_html("header.html", viewer)
        driver = ui.label().classes("pill").props("id=who")
        take_over = viewer.button(
            words("button.take_over"), viewer.take_over, props="id=take-over", small=True
        )
        ui.link(other[1], other[0]).classes("pill")
        if viewer.user_name:
            ui.link(words("button.logout"), LOGOUT).classes("pill").props("id=logout")
        if sound:
            _add_static_html("sound.html", viewer)
        contrast = ui.button(icon="contrast", on_click=toggle_dark, color=None)
        contrast.classes("btn plain small").props("flat id=shade")
        contrast.props["aria-label"] = words("label.shade")

    was_driver = [False]

    def show_driver() -> None:
        """Show the driver, the number of watchers and the button to take over."""
        is_driver = viewer.is_driver
        if was_driver[0] and not is_driver:
            viewer.show_note(
                words("who.taken"),
                position="bottom",
                holds=lambda: not viewer.is_driver and app_state.session.driver is not None,
            )
        was_driver[0] = is_driver
        others = len(app_state.session.viewers) - 1 if is_driver else 0
        texts = [words("who.driver"), *([words("who.watches", n=others)] if others else [])]
        if not is_driver:
            is_free = app_state.session.driver is None
            texts = [words("who.nobody" if is_free else "who.watcher")]
            if not viewer.may_drive:
                texts = [words("who.view")]
        driver.set_text(" · ".join(filter(None, (viewer.user_name, *texts))))
        take_over.set_visibility(viewer.may_drive and not is_driver)

    viewer.on_refresh(show_driver)


def _add_panel(
    app_state: AppState,
    viewer: Viewer,
    *,
    tab: str,
    item_id: str | None,
    recording: str | None,
) -> None:
    with ui.tabs().classes("w-full").props("dense no-caps align=justify") as tabs:
        for name in TABS:
            ui.tab(name, label=name)
    with ui.tab_panels(tabs, value=tab, animated=False).classes("panel-body"):
        with ui.tab_panel("Set up"):
            add_set_up_panel(app_state, viewer)
        with ui.tab_panel("Calibrate"):
            add_calibrate_panel(app_state, viewer)
        with ui.tab_panel("Doctor"):
            add_doctor_panel(app_state, viewer)
        with ui.tab_panel("Recordings"):
            open_recording = add_recordings_panel(app_state, viewer, name=recording)
        with ui.tab_panel("Items"):
            open_item = add_items_panel(app_state, viewer, item_id=item_id)
        with ui.tab_panel("Run"):
            add_run_panel(app_state, viewer)

    def show_item(event: GenericEventArguments) -> None:
        """Show an item on this page, so that the viewer remains the driver."""
        tabs.set_value("Items")
        open_item(str(event.args))

    def show_recording(event: GenericEventArguments) -> None:
        """Show a recording on this page."""
        tabs.set_value("Recordings")
        open_recording(str(event.args))

    ui.on("item", show_item)
    ui.on("recording", show_recording)

    def show_tab_of_url(event: GenericEventArguments) -> None:
        """Show the tab of the URL after the browser's back or forward button."""
        first, *rest = str(event.args).removeprefix("/").split("/", 1)
        tabs.set_value(next((name for name, path in TABS.items() if path == f"/{first}"), "Set up"))
        if rest and first == "items":
            open_item(unquote(rest[0]))

    ui.on("went", show_tab_of_url)
    # `visit` skips the push to the browser history if the URL already has this path.
    tabs.on_value_change(
        lambda event: ui.run_javascript(f"window.visit({json.dumps(TABS[event.value])})")
    )
    add_grasp_buttons(app_state, viewer)
