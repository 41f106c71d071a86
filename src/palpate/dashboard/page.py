"""The page: what must never leave the eye on top, the stage that shows, the panel that acts."""

from __future__ import annotations

import html
import json
import re
from copy import copy
from pathlib import Path
from typing import Any, cast

from nicegui import Client, ui
from nicegui.events import GenericEventArguments

from palpate.dashboard.activity import Action
from palpate.dashboard.address import qr_svg
from palpate.dashboard.app_state import AppState
from palpate.dashboard.html_parts import heading, paragraph
from palpate.dashboard.language import COOKIE, LANGUAGES, Language, Message, language_for
from palpate.dashboard.panel_calibrate import calibrate_panel
from palpate.dashboard.panel_doctor import doctor_panel
from palpate.dashboard.panel_grasp import grasp_buttons, item_field, set_up_panel
from palpate.dashboard.panel_items import items_panel
from palpate.dashboard.panel_recordings import recordings_panel
from palpate.dashboard.panel_run import run_panel
from palpate.dashboard.viewer import Viewer
from palpate.plots.pixel_colors import DEEPEST_PERCENT, FALL, RISE, css_gradient

_STATIC = Path(__file__).parent / "static"
_STAGE = (_STATIC / "stage.html").read_text(encoding="utf-8")
_STOP = (_STATIC / "stop.html").read_text(encoding="utf-8")
_SOUND = (_STATIC / "sound.html").read_text(encoding="utf-8")
_OPERATE = (_STATIC / "operate.html").read_text(encoding="utf-8")
#: What tabs are called, and the address of each.
TABS = {
    Message("Set up"): "/",
    Message("Calibrate"): "/calibrate",
    Message("Doctor"): "/doctor",
    Message("Recordings"): "/recordings",
    Message("Items"): "/items",
    Message("Run"): "/run",
}
#: The one map of every picture, for the page's script and its legend.
_PIXEL_COLORS = (
    f"<style>:root {{ --change-map: {css_gradient()} }}</style>"
    '<script id="pixel-colors" type="application/json">'
    + json.dumps({"fall": FALL, "rise": RISE, "deepest_percent": DEEPEST_PERCENT})
    + "</script>"
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
    """Fill the page of one viewer, with a tab of `TABS` open, and an item or a recording on it."""
    viewer = _begin(app_state, client, script="live.js")
    _header(app_state, viewer, other=("/operate", Message("Operate")))
    ui.on("seek", lambda event: viewer.seek(event.args))
    ui.on("pause", lambda event: viewer.pause(bool(event.args)))
    ui.on("speed", lambda event: viewer.set_speed(event.args))
    with ui.element("div").classes("page"):
        with ui.element("div").classes("stage"):
            _alerts(app_state, viewer)
            ui.html(_translated(_STAGE, viewer.tr), sanitize=False).classes("stage")
        with ui.element("aside").classes("card panel"):
            _panel(app_state, viewer, tab=tab, item_id=item_id, recording=recording)
    ui.timer(_REFRESH_S, viewer.refresh)


def build_operator_page(app_state: AppState, client: Client, *, kiosk: bool) -> None:
    """Fill the page that is read from two metres: verdict, what to do, force, three buttons.

    A `kiosk` leads nowhere else, and keeps its screen awake.
    """
    viewer = _begin(app_state, client, script="operate.js")
    ui.query("body").classes("operate kiosk" if kiosk else "operate")
    _header(app_state, viewer, other=None if kiosk else ("/", Message("Full page")), sound=True)
    with ui.element("div").classes("operator"):
        _alerts(app_state, viewer)
        ui.html(_translated(_OPERATE, viewer.tr), sanitize=False).classes("contents")
        with ui.element("div").classes("item") as item:
            item_field(app_state, viewer, label=viewer.tr("Next item"))
        viewer.show_with_gripper(item)
    grasp_buttons(app_state, viewer)
    ui.timer(_REFRESH_S, viewer.refresh)


def _begin(app_state: AppState, client: Client, *, script: str) -> Viewer:
    """Add what every view has, and let the viewer in."""
    asked = client.request.query_params.get("lang")
    chosen = asked or client.request.cookies.get(COOKIE)
    tr = language_for(chosen, client.request.headers.get("accept-language", ""))
    # The page is shared by all who visit it, but not its language.
    client.page = copy(client.page)
    client.page.language = cast(Any, tr.tag)
    ui.add_head_html('<link rel="stylesheet" href="/static/dashboard.css">')
    ui.add_head_html(_PIXEL_COLORS)
    # Apart from all that the framework draws, moves and takes away.
    ui.add_body_html(_translated(_STOP, tr))
    words = json.dumps(tr.words).replace("<", "\\u003c")
    ui.add_head_html(f'<script id="words" type="application/json">{words}</script>')
    ui.add_body_html(f'<script type="module" src="/static/{script}"></script>')
    # Not before its browser is there: what only fetched the page must not drive.
    client.on_connect(lambda: app_state.session.join(client.id, tab=client.tab_id))
    client.on_delete(lambda: app_state.session.leave(client.id))
    query = f"?lang={tr.code}" if asked else ""
    viewer = Viewer(app_state.session, viewer_id=client.id, tr=tr, query=query)
    ui.on("press", lambda event: viewer.pressed(event.args))
    return viewer


def _translated(parts: str, tr: Language) -> str:
    """Return HTML with each {{text}} in a language."""
    return re.sub(r"\{\{(.+?)\}\}", lambda found: html.escape(tr(found[1])), parts)


def _header(
    app_state: AppState, viewer: Viewer, *, other: tuple[str, str] | None, sound: bool = False
) -> None:
    dark, tr = ui.dark_mode(None), viewer.tr

    async def turn() -> None:
        """Turn light into dark and back; at first it is what the browser prefers."""
        is_dark = dark.value
        if is_dark is None:
            is_dark = await ui.run_javascript(f"matchMedia('{_PREFERS_DARK}').matches")
        dark.set_value(not is_dark)

    with ui.element("header").classes("bar"):
        brand = '<h1 class="brand">palpate<small id="rig-name"></small></h1>'
        ui.html(brand, sanitize=False).classes("contents")
        badge = f'<span id="simulated" class="badge-sim hidden">{tr("SIMULATED")}</span>'
        ui.html(badge, sanitize=False).classes("contents")
        ui.element("div").classes("grow")
        ui.html(
            '<span id="link" class="pill num" data-state="waiting"><span class="dot"></span>'
            f'<span id="link-text">{tr("connecting")}</span><span id="link-age"></span></span>'
            '<span id="link-state" class="visually-hidden" role="status"></span>',
            sanitize=False,
        )
        who = ui.label().classes("pill").props("id=who")
        take = ui.button(tr("Take over"), on_click=viewer.take_over, color=None)
        take.classes("btn plain small").props("flat no-caps id=take-over")
        if other is not None:
            ui.link(tr(other[1]), other[0] + viewer.query).classes("pill")
            _language_choice(tr)
        if sound:
            ui.html(_translated(_SOUND, tr), sanitize=False).classes("contents")
        if other is not None and app_state.address is not None:
            _phone_button(app_state.address, viewer)
        shade = ui.button(icon="contrast", on_click=turn, color=None)
        shade.classes("btn plain small").props("flat id=shade")
        shade.props["aria-label"] = tr("Light or dark")

    def drives() -> None:
        """Show who drives, how many watch, and the button to take over."""
        mine = viewer.drives
        others = len(app_state.session.viewers) - 1 if mine else 0
        watchers = tr.many("{n} watches", "{n} watch", others) if others else ""
        nobody = tr("nobody drives") if app_state.session.driver is None else tr("you watch")
        who.set_text(" · ".join(filter(None, (tr("you drive"), watchers))) if mine else nobody)
        take.set_visibility(not mine)

    viewer.on_refresh(drives)


def _language_choice(tr: Language) -> None:
    """Add the choice of a language; a script keeps it in this browser and loads the page again."""
    options = "".join(
        f'<option value="{code}" lang="{facts.tag}"{" selected" if code == tr.code else ""}>'
        f"{code.upper()}</option>"
        for code, facts in LANGUAGES.items()
    )
    label = html.escape(tr("Language"))
    ui.html(
        f'<select id="language" class="pill" data-cookie="{COOKIE}" aria-label="{label}">'
        f"{options}</select>",
        sanitize=False,
    ).classes("contents")


def _phone_button(address: str, viewer: Viewer) -> None:
    """Add what shows the address, which has no token in it, as a code to point a phone at."""
    tr = viewer.tr
    with ui.dialog() as dialog, ui.card().classes("care phone"):
        dialog.props["aria-label"] = tr("Open on a phone")
        heading(tr("Open on a phone"))
        code = ui.html(qr_svg(address + viewer.query), sanitize=False).classes("code")
        code.props("role=img").props["aria-label"] = tr("QR code of the address")
        ui.link(address + viewer.query, address + viewer.query)
        paragraph(tr("In the same network. It asks for the token once."))
        close = ui.button(tr("Close"), on_click=dialog.close, color=None)
        close.classes("btn plain").props("flat no-caps")
    opens = ui.button(icon="qr_code_2", on_click=dialog.open, color=None)
    opens.classes("btn plain small").props("flat id=phone")
    opens.props["aria-label"] = tr("Open on a phone")


def _alerts(app_state: AppState, viewer: Viewer) -> None:
    tr = viewer.tr
    ui.html(
        '<div id="trouble" class="alert bad hidden" role="alert">'
        '<span id="trouble-text"></span></div>',
        sanitize=False,
    ).classes("contents")
    with ui.element("div").classes("alert guide").props("id=guide role=status") as box:
        text = ui.label()
        bar = ui.linear_progress(value=0.0, show_value=False)
        bar.props["aria-label"] = tr("Progress")
        done = ui.button(tr("Done, go on"), on_click=viewer.confirm, color=None)
        done.classes("btn main small").props("flat no-caps id=confirm")

    def guides() -> None:
        """Show what a person is to do now, how far it is, and the button that confirms it."""
        guide = app_state.session.devices.guide
        box.set_visibility(guide is not None)
        if guide is None:
            return
        text.set_text(tr(guide.text))
        bar.set_visibility(guide.share is not None)
        bar.set_value(guide.share or 0.0)
        done.set_visibility(guide.asks)
        back = (
            app_state.session.devices.live.source is not None
            and app_state.session.devices.live.source.replayed
        )
        done.set_text(tr("Back to the rig") if back else tr("Done, go on"))

    viewer.on_refresh(guides)
    viewer.enable_when_allowed(done, Action.CONFIRM)


def _panel(
    app_state: AppState,
    viewer: Viewer,
    *,
    tab: str,
    item_id: str | None,
    recording: str | None,
) -> None:
    with ui.tabs().classes("w-full").props("dense no-caps align=justify") as tabs:
        for name in TABS:
            ui.tab(name, label=viewer.tr(name))
    with ui.tab_panels(tabs, value=tab, animated=False).classes("panel-body"):
        with ui.tab_panel("Set up"):
            set_up_panel(app_state, viewer)
        with ui.tab_panel("Calibrate"):
            calibrate_panel(app_state, viewer)
        with ui.tab_panel("Doctor"):
            doctor_panel(app_state, viewer)
        with ui.tab_panel("Recordings"):
            open_recording = recordings_panel(app_state, viewer, name=recording)
        with ui.tab_panel("Items"):
            open_item = items_panel(app_state, viewer, item_id=item_id)
        with ui.tab_panel("Run"):
            run_panel(app_state, viewer)

    def show_item(event: GenericEventArguments) -> None:
        """Turn to an item without leaving the page: who drives goes on driving."""
        tabs.set_value("Items")
        open_item(str(event.args))

    def show_recording(event: GenericEventArguments) -> None:
        """Turn to a recording likewise."""
        tabs.set_value("Recordings")
        open_recording(str(event.args))

    ui.on("item", show_item)
    ui.on("recording", show_recording)
    tabs.on_value_change(
        lambda event: ui.navigate.history.replace(TABS[event.value] + viewer.query)
    )
    grasp_buttons(app_state, viewer)
