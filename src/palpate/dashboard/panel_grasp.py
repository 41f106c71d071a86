"""What to grasp, how hard, with which rig; and the buttons that grasp and release."""

from __future__ import annotations

from nicegui import ui

from palpate.dashboard.desk import Desk
from palpate.dashboard.messages import OpenRig, Record
from palpate.dashboard.pressing import Hands
from palpate.dashboard.session import Action
from palpate.dashboard.wishes import Wishes
from palpate.errors import InputError
from palpate.estimate.damage_file import DamageFile

SPEEDS = {1.0: "1×", 2.0: "2×", 5.0: "5×", 10.0: "10×"}
_DRAWN = "drawn by the seed"


def set_up_panel(desk: Desk, hands: Hands) -> None:
    """Fill the panel."""
    wishes = desk.wishes
    with ui.element("div").classes("form"):

        def want(force_n: float | None) -> None:
            wishes.target_force_n = force_n

        force = ui.number(
            "Target force, N (empty: a gentle squeeze)",
            value=wishes.target_force_n,
            min=0.1,
            step=0.5,
            on_change=lambda event: want(event.value),
        ).props("outlined dense clearable")

        def show() -> None:
            force.set_value(wishes.target_force_n)

        hands.on_refresh(show)
        item_field(desk, hands, label="Item (empty: not remembered)")
        ui.label("Grasps of an item are kept in the store; the page Items shows them.").classes(
            "muted"
        )
        if desk.settings.damage is not None:
            _kind(desk.settings.damage, wishes, hands)
        ui.separator()
        _rig(desk, hands)
        ui.separator()
        _recording(desk, hands)


def item_field(desk: Desk, hands: Hands, *, label: str) -> None:
    """Ask for the name of the item that is grasped next."""
    wishes = desk.wishes

    def name(item_id: str | None) -> None:
        wishes.item_id = item_id or ""

    item = ui.input(label, value=wishes.item_id, on_change=lambda event: name(event.value))
    item.props("outlined dense clearable maxlength=80 autocomplete=off")

    def show() -> None:
        if (item.value or "") != wishes.item_id:
            item.set_value(wishes.item_id)

    hands.on_refresh(show)


def _kind(damage: DamageFile, wishes: Wishes, hands: Hands) -> None:
    """Ask what is grasped, of the kinds whose limits were learned."""

    def tell(kind: str) -> None:
        wishes.kind = kind

    known = {"": "not told", **{kind: kind for kind in damage.kinds}}
    kind = ui.select(known, value=wishes.kind, on_change=lambda event: tell(event.value))
    kind.props('outlined dense behavior=dialog label="Kind (for its damage limit)"').classes(
        "w-full"
    )

    def show() -> None:
        kind.set_value(wishes.kind)

    hands.on_refresh(show)
    ui.label("Grasps stay below what such produce bears, as far as they feel it.").classes("muted")


def grasp_buttons(desk: Desk, hands: Hands) -> None:
    """Add the two buttons that are always in reach."""

    wishes = desk.wishes

    def grasp() -> None:
        try:
            order = desk.grasp_order(
                target_force_n=wishes.target_force_n,
                item_id=wishes.item_id.strip(),
                kind=wishes.kind,
            )
        except InputError as error:
            ui.notify(str(error), type="warning")
        else:
            hands.order(order)

    go = ui.button("Grasp", on_click=grasp, color=None).classes("btn main")
    go.props("flat no-caps id=grasp")
    back = ui.button("Release", on_click=hands.release, color=None).classes("btn plain")
    back.props("flat no-caps id=release").style("font-size: 19px")
    hands.gate(go, Action.GRASP)
    hands.gate(back, Action.RELEASE)


def _recording(desk: Desk, hands: Hands) -> None:
    def record(wanted: bool) -> None:
        if wanted != (desk.session.recording is not None):
            hands.order(Record(desk.new_recording("watched") if wanted else None))

    recording = ui.switch("Record what is watched", on_change=lambda event: record(event.value))
    hands.gate(recording, Action.RECORD)

    def show() -> None:
        recording.set_value(desk.session.recording is not None)

    hands.on_refresh(show)
    ui.label("Every grasp is recorded anyway. It holds until Release, for 60 s at most.").classes(
        "muted"
    )


def _rig(desk: Desk, hands: Hands) -> None:
    settings, asked = desk.settings, desk.session.rig
    name = ui.select(list(settings.rigs), value=asked.name if asked else settings.rigs[0])
    name.props('outlined dense behavior=dialog label="Rig"').classes("w-full")
    with ui.element("div").classes("form") as simulated:
        known = asked.object_name if asked else None
        what = ui.select([_DRAWN, *settings.objects], value=known or _DRAWN)
        what.props('outlined dense behavior=dialog label="Object between the fingers"')
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
