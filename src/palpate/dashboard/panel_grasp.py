"""The panel that grasps: which rig, what object, how hard; grasp and release."""

from __future__ import annotations

from nicegui import ui

from palpate.dashboard.desk import Desk
from palpate.dashboard.messages import Grasp, OpenRig, Record
from palpate.dashboard.pressing import Hands
from palpate.dashboard.session import Action
from palpate.grasp.safety import FORCE_CEILING_N

SPEEDS = {1.0: "1×", 2.0: "2×", 5.0: "5×", 10.0: "10×"}
_DRAWN = "drawn by the seed"


def grasp_panel(desk: Desk, hands: Hands) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        _pressing(desk, hands)
        ui.separator()
        _rig(desk, hands)


def _pressing(desk: Desk, hands: Hands) -> None:
    target = ui.number(
        "Target force, N (empty: a gentle squeeze)", min=0.1, max=FORCE_CEILING_N, step=0.5
    ).props("outlined dense clearable")
    item = ui.input("Item (empty: not remembered)").props("outlined dense clearable maxlength=80")
    item.tooltip("Its grasps are kept in the store, and its history is on the page Items")

    def grasp() -> None:
        wanted = None if target.value in (None, "") else float(target.value)
        if wanted is not None and not 0 < wanted <= FORCE_CEILING_N:
            ui.notify(f"target force: above 0 and at most {FORCE_CEILING_N:g} N", type="warning")
            return
        desk.session.item_id = (item.value or "").strip()
        recording = desk.new_recording(desk.session.item_id or "grasp")
        hands.order(Grasp(target_force_n=wanted, recording=recording))

    with ui.element("div").classes("two"):
        go = ui.button("Grasp", on_click=grasp, color=None).classes("btn main")
        back = ui.button("Release", on_click=hands.release, color=None).classes("btn plain")
    go.props("flat no-caps id=grasp")
    back.props("flat no-caps id=release").style("min-height: 64px; font-size: 20px")
    hands.gate(go, Action.GRASP)
    hands.gate(back, Action.RELEASE)
    recording = ui.switch("Record what is watched", on_change=lambda event: record(event.value))

    def record(wanted: bool) -> None:
        if wanted != (desk.session.recording is not None):
            hands.order(Record(desk.new_recording("watched") if wanted else None))

    hands.gate(recording, Action.RECORD)

    def show() -> None:
        recording.set_value(desk.session.recording is not None)

    hands.on_refresh(show)
    ui.label("Every grasp is recorded. It holds until Release, at most 60 s.").classes("muted")


def _rig(desk: Desk, hands: Hands) -> None:
    settings, asked = desk.settings, desk.session.rig
    name = ui.select(list(settings.rigs), value=asked.name if asked else settings.rigs[0])
    name.props('outlined dense label="Rig"').classes("w-full")
    with ui.element("div").classes("form") as simulated:
        known = asked.object_name if asked else None
        what = ui.select([_DRAWN, *settings.objects], value=known or _DRAWN)
        what.props('outlined dense label="Object between the fingers"')
        with ui.element("div").classes("two"):
            seed = ui.number("Seed", value=asked.seed if asked else 0, min=0, step=1, format="%d")
            seed.props("outlined dense")
            speed = ui.toggle(
                SPEEDS,
                value=asked.speed if asked and asked.speed in SPEEDS else 1.0,
                on_change=lambda event: hands.set_speed(event.value),
            ).props('unelevated no-caps aria-label="Speed of simulated time"')
            speed.tooltip("Seconds of simulated time in a second")
    simulated.bind_visibility_from(name, "value", backward=lambda rig: rig.startswith("sim-"))

    def use() -> None:
        hands.order(
            OpenRig(
                name=name.value,
                object_name=None if what.value == _DRAWN else what.value,
                seed=int(seed.value or 0),
                speed=speed.value,
            )
        )

    button = ui.button("Use this rig", on_click=use, color=None)
    button.classes("btn plain").props("flat no-caps id=use-rig")
    hands.gate(button, Action.OPEN)
