"""The page: what must never leave the eye on top, the stage that shows, the panel that acts."""

from __future__ import annotations

from pathlib import Path

from nicegui import Client, ui

from palpate.dashboard.desk import Desk
from palpate.dashboard.panel_calibrate import calibrate_panel
from palpate.dashboard.panel_doctor import doctor_panel
from palpate.dashboard.panel_grasp import Wishes, grasp_buttons, set_up_panel
from palpate.dashboard.panel_items import items_panel
from palpate.dashboard.panel_recordings import recordings_panel
from palpate.dashboard.pressing import Hands
from palpate.dashboard.session import Action

_STATIC = Path(__file__).parent / "static"
_STAGE = (_STATIC / "stage.html").read_text(encoding="utf-8")
_STOP = (_STATIC / "stop.html").read_text(encoding="utf-8")
_PANELS = {
    "Calibrate": calibrate_panel,
    "Doctor": doctor_panel,
    "Recordings": recordings_panel,
    "Items": items_panel,
}
_REFRESH_S = 0.2
_PREFERS_DARK = "(prefers-color-scheme: dark)"


def build_page(desk: Desk, client: Client) -> None:
    """Fill the page of one viewer."""
    ui.add_head_html('<link rel="stylesheet" href="/static/dashboard.css">')
    # Apart from all that the framework draws, moves and takes away.
    ui.add_body_html(_STOP)
    ui.add_body_html('<script type="module" src="/static/live.js"></script>')
    hands = Hands(desk.session, viewer=client.id)
    # Not before its browser is there: what only fetched the page must not drive.
    client.on_connect(lambda: desk.session.join(client.id))
    client.on_delete(lambda: desk.session.leave(client.id))
    _header(desk, hands)
    with ui.element("main").classes("page"):
        with ui.element("div").classes("stage"):
            _alerts(desk, hands)
            ui.html(_STAGE, sanitize=False).classes("stage")
        with ui.element("aside").classes("card panel"):
            _panel(desk, hands)
    ui.timer(_REFRESH_S, hands.refresh)


def _header(desk: Desk, hands: Hands) -> None:
    dark = ui.dark_mode(None)

    async def turn() -> None:
        """Turn light into dark and back; at first it is what the browser prefers."""
        is_dark = dark.value
        if is_dark is None:
            is_dark = await ui.run_javascript(f"matchMedia('{_PREFERS_DARK}').matches")
        dark.set_value(not is_dark)

    with ui.element("header").classes("bar"):
        ui.html('<span class="brand">palpate<small id="rig-name"></small></span>', sanitize=False)
        ui.html('<span id="simulated" class="badge-sim hidden">SIMULATED</span>', sanitize=False)
        ui.element("div").classes("grow")
        ui.html(
            '<span id="link" class="pill num" role="status" data-state="waiting">'
            '<span class="dot"></span><span id="link-text">connecting</span></span>',
            sanitize=False,
        )
        who = ui.label().classes("pill").props("id=who")
        take = ui.button("Take over", on_click=hands.take_over, color=None)
        take.classes("btn plain small").props("flat no-caps id=take-over")
        shade = ui.button(icon="contrast", on_click=turn, color=None)
        shade.classes("btn plain small").props('flat id=shade aria-label="Light or dark"')

    def drives() -> None:
        mine = hands.drives
        others = len(desk.session.viewers) - 1 if mine else 0
        beside = f" · {others} watch{'es' if others == 1 else ''}" if others else ""
        nobody = "nobody drives" if desk.session.driver is None else "you watch"
        who.set_text(f"you drive{beside}" if mine else nobody)
        take.set_visibility(not mine)

    hands.on_refresh(drives)


def _alerts(desk: Desk, hands: Hands) -> None:
    ui.html(
        '<div id="trouble" class="alert bad hidden" role="alert">'
        '<span id="trouble-text"></span></div>',
        sanitize=False,
    ).classes("contents")
    with ui.element("div").classes("alert guide").props("id=guide role=status") as box:
        text = ui.label()
        bar = ui.linear_progress(value=0.0, show_value=False)
        done = ui.button("Done, go on", on_click=hands.confirm, color=None)
        done.classes("btn main small").props("flat no-caps id=confirm")

    def guides() -> None:
        guide = desk.session.guide
        box.set_visibility(guide is not None)
        if guide is None:
            return
        text.set_text(guide.text)
        bar.set_visibility(guide.share is not None)
        bar.set_value(guide.share or 0.0)
        done.set_visibility(guide.asks)
        back = desk.session.live.source is not None and desk.session.live.source.replayed
        done.set_text("Back to the rig" if back else "Done, go on")

    hands.on_refresh(guides)
    hands.gate(done, Action.CONFIRM)


def _panel(desk: Desk, hands: Hands) -> None:
    with ui.tabs().classes("w-full").props("dense no-caps align=justify") as tabs:
        pages = {name: ui.tab(name) for name in ("Set up", *_PANELS)}
    wishes = Wishes()
    with ui.tab_panels(tabs, value="Set up", animated=False).classes("panel-body"):
        with ui.tab_panel(pages["Set up"]):
            set_up_panel(desk, hands, wishes)
        for name, build in _PANELS.items():
            with ui.tab_panel(pages[name]):
                build(desk, hands)
    with ui.element("div").classes("panel-foot"):
        grasp_buttons(desk, hands, wishes)
