"""The panel of item, target force and rig, with the buttons of a grasp."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from palpate.errors import InputError, PalpateError
from palpate.object.damage_file import DamageFile
from palpate.rig import BUILT_IN
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.folder import make_recording_path
from palpate_station.dashboard.grasp_form import GraspForm, short_name
from palpate_station.dashboard.item_store import error_text
from palpate_station.dashboard.messages import Action, DeviceActivity, OpenRig, Record, SetSpeed
from palpate_station.dashboard.viewer import Viewer, finite_number

SPEEDS = {1.0: "1×", 2.0: "2×", 5.0: "5×", 10.0: "10×"}
#: Value of the object choice "random"; no object has this name.
_DRAWN_BY_SEED = ""


def add_set_up_panel(app_state: AppState, viewer: Viewer) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        with ui.element("div").classes("form") as next_grasp:
            _add_grasp_form(app_state, viewer)
            ui.separator()
        viewer.show_with_gripper(next_grasp)
        _add_rig_form(app_state, viewer)
        ui.separator()
        _add_recording_switch(app_state, viewer)


def _add_grasp_form(app_state: AppState, viewer: Viewer) -> None:
    form = app_state.session.form

    def set_target(force_n: object) -> None:
        wanted_n = finite_number(force_n)
        if wanted_n != form.target_force_n and viewer.claim():
            form.target_force_n = wanted_n

    force = ui.number(
        "Target force, N (empty: a gentle squeeze)",
        value=form.target_force_n,
        min=0.1,
        step=0.5,
        on_change=lambda event: set_target(event.value),
    ).props("outlined dense clearable")
    viewer.enable_for_driver(force)
    viewer.on_refresh(lambda: force.set_value(form.target_force_n))
    add_item_field(app_state, viewer, label="Item", label_again="Item")
    lot = ui.input("Lot (empty: without a name)", value=app_state.history.lot.name)
    lot.props("outlined dense maxlength=80 autocomplete=off")
    with lot.add_slot("append"):
        text = "Start lot"
        viewer.button(
            text,
            lambda: viewer.run_action(
                Action.FILES, lambda: app_state.start_lot((lot.value or "").strip())
            ),
            props="id=start-lot",
            small=True,
        )
    viewer.enable_for_driver(lot)
    hint = "Grasps of a named item are stored; the tab Items shows them."
    ui.label(hint).classes("muted")
    if app_state.settings.damage is not None:
        _add_kind_choice(app_state.settings.damage, form, viewer)


def add_item_field(app_state: AppState, viewer: Viewer, *, label: str, label_again: str) -> None:
    """Add the field for the next item's name: typed, scanned or the last name.

    `label_again`: the label while the last item is to be grasped again. A damaged label is shown in
    red with the reason, and is not taken.
    """
    form, words = app_state.session.form, viewer.words

    def set_item(item_id: object) -> None:
        text = item_id.strip() if isinstance(item_id, str) else ""
        if text != form.item_id and viewer.claim():
            form.set_item(text)

    def end_scan() -> None:
        """Take the name at the end of a scan, or report why not."""
        if viewer.may_act:
            if form.label_fault:
                item_id = form.item_id
                viewer.refuse(form.label_fault, holds=lambda: form.item_id == item_id)
            elif doubt := form.end_scan(words):
                viewer.refuse(doubt)
        viewer.refresh()

    def repeat_item() -> None:
        """Set the last item as the next one."""
        if viewer.claim():
            form.repeat_item()

    item = ui.input(label, value=form.item_id, on_change=lambda event: set_item(event.value))
    # Enter selects the text, so that the next scan replaces it.
    item.props("outlined dense clearable maxlength=80 autocomplete=off input-class=scanned")
    item.on("keydown.enter", js_handler="(event) => event.target.select()")
    item.on("keydown.enter", end_scan, args=[])
    with item.add_slot("append"):
        same_item = viewer.button("", repeat_item, props="id=same-item", small=True)
    viewer.enable_for_driver(item)

    def show() -> None:
        if (item.value or "").strip() != form.item_id:
            item.set_value(form.item_id)
        is_long = short_name(form.item_id) != form.item_id
        shown = label_again if form.is_returned and form.item_id else label
        shown = f"{shown} {short_name(form.item_id)}" if is_long else shown
        is_clear = not app_state.session.name_fault
        state = "" if not form.item_id else "taken" if is_clear else "refused"
        item.classes(add=state, remove=" ".join({"taken", "refused"} - {state}))
        # A grasp has taken its name, and the next item may be scanned meanwhile.
        is_grasping = app_state.session.devices.activity is DeviceActivity.GRASPING
        none = "item.needed" if app_state.session.requires_item else "item.unnamed"
        hint = {"": None if is_grasping else none, "refused": "item.refused"}.get(state)
        item.props["label"] = shown if hint is None else words(hint, label=label)
        same_item.set_text(words("item.same", name=short_name(form.last_item_id, letters=8)))
        can_repeat = bool(form.last_item_id) and not form.item_id and not is_grasping
        same_item.set_visibility(can_repeat and viewer.may_act)

    viewer.on_refresh(show)


def add_bin_correction(app_state: AppState, viewer: Viewer) -> None:
    """Add the button and the dialog that give the last item another bin."""
    words, devices = viewer.words, app_state.session.devices

    async def correct(item_id: str, name: str) -> None:
        """Store the bin with the name of its giver, and show it."""
        giver = viewer.user_name or str(by.value or "").strip()
        if not giver:
            viewer.refuse(words("correct.unnamed"))
            return
        try:
            await app_state.give_bin(item_id, name, by=giver)
        except PalpateError as error:
            viewer.refuse(error_text(error))
        dialog.close()
        viewer.refresh()

    def ask() -> None:
        """Ask for the right bin of the shown item."""
        item_id, placed = devices.item_id, devices.placed
        title.set_text(words("correct.title", item=short_name(item_id)))
        choices.clear()
        with choices:
            for name in app_state.session.bins:
                if placed is None or placed.bin_name != name:
                    viewer.button(name, partial(correct, item_id, name))
        dialog.open()

    with ui.dialog() as dialog, ui.element("div").classes("card care form q-pa-md"):
        title = ui.label().classes("result")
        by = ui.input(words("correct.by")).props("outlined dense maxlength=80")
        by.set_visibility(not viewer.user_name)
        choices = ui.element("div").classes("form")
        viewer.button(words("button.cancel"), dialog.close)
    button = viewer.button(words("button.wrong_bin"), ask, props="id=wrong-bin", small=True)

    def show() -> None:
        """Show the button while the last item has a stored bin."""
        placed = devices.placed
        has_bin = placed is not None and placed.stored is True and placed.bin is not None
        button.set_visibility(has_bin and devices.item_id != "" and viewer.may_act)

    viewer.on_refresh(show)


def _add_kind_choice(damage: DamageFile, form: GraspForm, viewer: Viewer) -> None:
    """Add the choice of the kind among the kinds with a learned damage limit."""

    def set_kind(kind: str) -> None:
        if kind != form.kind and viewer.claim():
            form.kind = kind

    options = {"": "not given", **{kind: kind for kind in damage.kinds}}
    kind = ui.select(options, value=form.kind, on_change=lambda event: set_kind(event.value))
    kind.props("outlined dense behavior=dialog").classes("w-full")
    kind.props["label"] = "Kind (for its damage limit)"
    viewer.enable_for_driver(kind)
    viewer.on_refresh(lambda: kind.set_value(form.kind))
    hint = "Grasps stay below the learned damage limit of this kind."
    ui.label(hint).classes("muted")


def add_grasp_buttons(app_state: AppState, viewer: Viewer) -> None:
    """Add the buttons Grasp and Release at the bottom of the panel or window."""
    form = app_state.session.form

    def grasp() -> None:
        """Order a grasp with the settings of the form, or show a refusal."""
        asked = (form.target_force_n, form.item_id, form.kind)
        # A scanner may end its text without Enter.
        if viewer.may_act and not form.label_fault and (doubt := form.end_scan(viewer.words)):
            viewer.refuse(doubt)
            viewer.refresh()
            return
        try:
            order = app_state.grasp_order(
                target_force_n=form.target_force_n, item_id=form.item_id, kind=form.kind
            )
        except InputError as error:
            viewer.refuse(
                error, holds=lambda: asked == (form.target_force_n, form.item_id, form.kind)
            )
            return
        if viewer.order(order):
            form.take_item(order)
            viewer.refresh()

    with ui.element("div").classes("panel-foot") as foot:
        grasp_button = ui.button(viewer.words("button.grasp"), on_click=grasp, color=None).classes(
            "btn main"
        )
        grasp_button.props('flat no-caps id=grasp aria-keyshortcuts="F8"')
        viewer.enable_when_allowed(grasp_button, Action.GRASP)
        shortcut = 'id=release aria-keyshortcuts="F9"'
        release_button = viewer.button(
            viewer.words("button.release"), viewer.release, props=shortcut, action=Action.RELEASE
        )
        release_button.style("font-size: 19px")

    def show_blocked() -> None:
        """Show whether a grasp has a clear name; a press then still says what is wrong."""
        is_blocked = app_state.session.name_fault != ""
        grasp_button.classes(**{"add" if is_blocked else "remove": "blocked"})

    viewer.on_refresh(show_blocked)
    viewer.show_with_gripper(foot)


def _add_recording_switch(app_state: AppState, viewer: Viewer) -> None:
    def record(is_wanted: bool) -> None:
        """Start or end a recording, if its state differs."""
        if is_wanted != (app_state.session.devices.recording is not None):
            folder = app_state.settings.folder
            viewer.order(Record(make_recording_path(folder, "watched") if is_wanted else None))

    recording = ui.switch("Record between grasps")
    recording.on_value_change(lambda event: record(event.value))
    viewer.enable_when_allowed(recording, Action.RECORD)

    def show() -> None:
        recording.set_value(app_state.session.devices.recording is not None)

    viewer.on_refresh(show)
    hint = "Every grasp is recorded. The hand holds until Release, at most 60 s."
    viewer.show_with_gripper(ui.label(hint).classes("muted"))


def _seed_of(value: object) -> int:
    """Return the seed of the form; -1, which the session refuses, if not an integer."""
    number = finite_number(0 if value is None else value)
    return -1 if number is None or number % 1 else int(number)


def _add_rig_form(app_state: AppState, viewer: Viewer) -> None:
    settings, requested = app_state.settings, app_state.session.rig
    name = ui.select(list(settings.rigs), value=requested.name if requested else settings.rigs[0])
    name.props("outlined dense behavior=dialog").classes("w-full").props["label"] = "Rig"
    with ui.element("div").classes("form") as simulated:
        object_name = requested.object_name if requested else None
        named = {name: name for name in settings.objects}
        object_choice = ui.select(
            {_DRAWN_BY_SEED: "random, from the seed", **named}, value=object_name or _DRAWN_BY_SEED
        )
        object_choice.props("outlined dense behavior=dialog")
        object_choice.props["label"] = "Object between the fingers"
        with ui.element("div").classes("two"):
            seed = ui.number(
                "Seed", value=requested.seed if requested else 0, min=0, step=1, format="%d"
            )
            seed.props("outlined dense")
            speed = ui.toggle(
                SPEEDS,
                value=requested.speed if requested and requested.speed in SPEEDS else None,
                on_change=lambda event: viewer.request(SetSpeed(event.value)),
            ).props("unelevated no-caps")
            speed.props["aria-label"] = "Speed of simulated time"
            speed.props["title"] = "Simulated seconds per real second"
    simulated.bind_visibility_from(name, "value", backward=lambda rig: rig.startswith("sim-"))

    def open_rig() -> None:
        """Order the chosen rig to be opened."""
        viewer.order(
            OpenRig(
                name=name.value,
                object_name=object_choice.value or None,
                seed=_seed_of(seed.value),
                speed=speed.value or (requested.speed if requested else 1.0),
                rate_hz=settings.rate_hz if name.value in BUILT_IN else None,
            )
        )

    viewer.button("Use this rig", open_rig, props="id=use-rig", action=Action.OPEN)
