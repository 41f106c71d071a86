"""The panels of the sensor: calibration of rest and force, and examination."""

from __future__ import annotations

import html
from functools import partial

from markupsafe import Markup
from nicegui import run, ui

from palpate.calibrate.dead_weights import check_loads, parse_load
from palpate.calibration import Calibration
from palpate.errors import InputError, PalpateError
from palpate.sensor.findings import Severity
from palpate.sensor.health import Health
from palpate_station.dashboard.app_state import AppState, age_text
from palpate_station.dashboard.device_state import CalibrationFailure
from palpate_station.dashboard.messages import (
    Action,
    CalibrateForce,
    CalibrateRest,
    CalibrationRenewed,
    Examine,
)
from palpate_station.dashboard.panel_html import draw_panel_svg, panel_html
from palpate_station.dashboard.viewer import Viewer, add_heading, add_paragraph
from palpate_station.dashboard.words import Words

_LOADS = "0.5 1 2 4 8 4 2 1"


def add_calibrate_panel(app_state: AppState, viewer: Viewer) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        add_heading("1. Rest")
        add_paragraph(
            "Readings of the unloaded pixels. Remove everything from the sensor and do not touch "
            "it for a few seconds. A gripper opens first."
        )
        viewer.button(
            "Calibrate the rest",
            lambda: viewer.order(CalibrateRest(file=app_state.calibration_file())),
            props="id=calibrate-rest",
            action=Action.CALIBRATE,
        )
        add_heading("2. Force")
        _add_force_calibration(app_state, viewer)
        _add_calibration_result(app_state, viewer)
        _add_force_in_use(app_state)


def _add_force_calibration(app_state: AppState, viewer: Viewer) -> None:
    instructions = ui.html("", sanitize=False)
    loads = ui.input("Loads in order, up and down: newtons, or 100g", value=_LOADS)
    loads.props("outlined dense")

    def start() -> None:
        """Order a force calibration, with the entered weights if there is no load cell."""
        weights: tuple[float, ...] = ()
        source = app_state.session.devices.live.source
        if source is None or not source.has_load_cell:
            typed = loads.value
            try:
                weights = tuple(
                    check_loads(map(parse_load, typed.replace(",", " ").split()), where="loads")
                )
            except InputError as error:
                viewer.refuse(error, holds=lambda: loads.value == typed)
                return
        viewer.order(CalibrateForce(file=app_state.calibration_file(), loads_n=weights))

    button = viewer.button(
        "Calibrate the force", start, props="id=calibrate-force", action=Action.CALIBRATE
    )

    def explain() -> None:
        """Show the instructions for the open rig."""
        source = app_state.session.devices.live.source
        cell = source is not None and source.has_load_cell
        simulated = source is not None and source.is_simulated
        loads.set_visibility(not cell and not simulated)
        button.set_visibility(cell or not simulated)
        instructions.set_content(
            f"<p>{html.escape(_instructions(cell=cell, simulated=simulated))}</p>"
        )

    viewer.on_refresh(explain)


def _instructions(*, cell: bool, simulated: bool) -> str:
    if cell:
        return (
            "A simulated load cell is placed between the fingers six times, and the hand closes on "
            "it in steps. The simulation runs as fast as this computer allows."
        )
    if simulated:
        return "This simulated rig has no load cell, so its force can't be calibrated."
    return (
        "Place dead weights on one pad as instructed, in increasing and then decreasing order. "
        "Each weight settles for 20 s."
    )


def _add_calibration_result(app_state: AppState, viewer: Viewer) -> None:
    box = ui.html("", sanitize=False).props("id=calibrated")
    devices = app_state.session.devices

    def show(ended: CalibrationRenewed | CalibrationFailure | None) -> None:
        match ended:
            case CalibrationRenewed():
                box.set_content(panel_html("calibrated", made=ended))
            case CalibrationFailure():
                box.set_content(panel_html("failure", failure=ended))

    viewer.on_change(lambda: devices.calibration_failure or devices.calibrated, show)


def _add_force_in_use(app_state: AppState) -> None:
    """Show the current force calibration: curve, residuals and age."""
    box = ui.html("", sanitize=False).props("id=force-in-use")
    shown = [""]

    async def show() -> None:
        """Redraw the calibration if it has changed."""
        source = app_state.session.devices.live.source
        text = "" if source is None else source.calibration
        if text == shown[0]:
            return
        shown[0] = text
        try:
            drawn = await run.io_bound(_force_html, text)
        except PalpateError as error:
            drawn = f"<p class='note'>{html.escape(str(error))}</p>"
        if not box.is_deleted:
            box.set_content(drawn or "")

    ui.timer(1.0, show)


def _force_html(text: str) -> str:
    if not text or not (made := Calibration.from_text(text, where="the rig")).force_law:
        return "<p>Without a force calibration, the page shows no forces.</p>"
    from palpate.plots.force_calibration import force_calibration_figure

    age = age_text(made.made_at) if made.made_at else ""
    figure = draw_panel_svg(
        partial(force_calibration_figure, made),
        label="Current force calibration and its errors",
        height_in=3.6,
    )
    return panel_html("force_in_use", made=made, age=age, figure=Markup(figure))


def add_doctor_panel(app_state: AppState, viewer: Viewer) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        add_heading("Sensor check")
        add_paragraph(
            "Detects open, shorted, stuck, noisy and drifting pixels, lost frames, and a wrong "
            "reference resistor. Nothing may touch the sensor for 10 s."
        )
        viewer.button(
            "Examine",
            lambda: viewer.order(Examine()),
            props="id=examine",
            action=Action.EXAMINE,
        )
        box = ui.html("", sanitize=False).props("id=health")
    viewer.on_change(
        lambda: app_state.session.devices.health,
        lambda health: box.set_content(
            "" if health is None else findings_html(health, words=viewer.words)
        ),
    )


def findings_html(health: Health, *, words: Words) -> str:
    """Return the findings of an examination as HTML."""
    faults = sum(found.severity is Severity.FAULT for found in health.findings)
    return panel_html("health", health=health, faults=faults, name=words.name_parts)
