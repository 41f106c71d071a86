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
#: Stands for no object in particular; none is named so.
_DRAWN = ""


def set_up_panel(desk: Desk, hands: Hands) -> None:
    """Fill the panel."""
    wishes, tr = desk.wishes, hands.tr
    with ui.element("div").classes("form"):

        def want(force_n: float | None) -> None:
            wishes.target_force_n = force_n

        force = ui.number(
            tr("Target force, N (empty: a gentle squeeze)"),
            value=wishes.target_force_n,
            min=0.1,
            step=0.5,
            on_change=lambda event: want(event.value),
        ).props("outlined dense clearable")

        def show() -> None:
            force.set_value(wishes.target_force_n)

        hands.on_refresh(show)
        item_field(desk, hands, label=tr("Item (empty: not remembered)"))
        hint = tr("Grasps of an item are kept in the store; the page Items shows them.")
        ui.label(hint).classes("muted")
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

    known = {"": hands.tr("not told"), **{kind: kind for kind in damage.kinds}}
    kind = ui.select(known, value=wishes.kind, on_change=lambda event: tell(event.value))
    kind.props("outlined dense behavior=dialog").classes("w-full")
    kind.props["label"] = hands.tr("Kind (for its damage limit)")

    def show() -> None:
        kind.set_value(wishes.kind)

    hands.on_refresh(show)
    hint = hands.tr("Grasps stay below what such produce bears, as far as they feel it.")
    ui.label(hint).classes("muted")


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
            hands.refuse(error)
        else:
            hands.order(order)

    go = ui.button(hands.tr("Grasp"), on_click=grasp, color=None).classes("btn main")
    go.props("flat no-caps id=grasp")
    back = ui.button(hands.tr("Release"), on_click=hands.release, color=None).classes("btn plain")
    back.props("flat no-caps id=release").style("font-size: 19px")
    hands.gate(go, Action.GRASP)
    hands.gate(back, Action.RELEASE)


def _recording(desk: Desk, hands: Hands) -> None:
    def record(wanted: bool) -> None:
        if wanted != (desk.session.recording is not None):
            hands.order(Record(desk.new_recording("watched") if wanted else None))

    tr = hands.tr
    recording = ui.switch(tr("Record what is watched"))
    recording.on_value_change(lambda event: record(event.value))
    hands.gate(recording, Action.RECORD)

    def show() -> None:
        recording.set_value(desk.session.recording is not None)

    hands.on_refresh(show)
    hint = tr("Every grasp is recorded anyway. It holds until Release, for 60 s at most.")
    ui.label(hint).classes("muted")


def _rig(desk: Desk, hands: Hands) -> None:
    settings, asked, tr = desk.settings, desk.session.rig, hands.tr
    name = ui.select(list(settings.rigs), value=asked.name if asked else settings.rigs[0])
    name.props("outlined dense behavior=dialog").classes("w-full").props["label"] = tr("Rig")
    with ui.element("div").classes("form") as simulated:
        known = asked.object_name if asked else None
        named = {name: name for name in settings.objects}
        what = ui.select({_DRAWN: tr("drawn by the seed"), **named}, value=known or _DRAWN)
        what.props("outlined dense behavior=dialog")
        what.props["label"] = tr("Object between the fingers")
        with ui.element("div").classes("two"):
            seed = ui.number(
                tr("Seed"), value=asked.seed if asked else 0, min=0, step=1, format="%d"
            )
            seed.props("outlined dense")
            speed = ui.toggle(
                SPEEDS,
                value=asked.speed if asked and asked.speed in SPEEDS else 1.0,
                on_change=lambda event: hands.set_speed(event.value),
            ).props("unelevated no-caps")
            speed.props["aria-label"] = tr("Speed of simulated time")
            speed.tooltip(tr("Seconds of simulated time in a second"))
    simulated.bind_visibility_from(name, "value", backward=lambda rig: rig.startswith("sim-"))

    def use() -> None:
        hands.order(
            OpenRig(
                name=name.value,
                object_name=what.value or None,
                seed=int(seed.value or 0),
                speed=speed.value,
            )
        )

    button = ui.button(tr("Use this rig"), on_click=use, color=None)
    button.classes("btn plain").props("flat no-caps id=use-rig")
    hands.gate(button, Action.OPEN)
