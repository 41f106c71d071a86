"""The panels of the sensor: one calibrates rest and newtons, one examines."""

from __future__ import annotations

import html
import math
import re

from nicegui import ui

from palpate.dashboard.app_state import AppState
from palpate.dashboard.device_state import CalibrationFailure
from palpate.dashboard.messages import Calibrated
from palpate.dashboard.orders import Action, CalibrateForce, CalibrateRest, Examine
from palpate.dashboard.viewer import Viewer, count_of, heading, number_text, paragraph
from palpate.errors import InputError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.dead_weights import check_loads
from palpate.sensor.findings import Severity, pixel_name
from palpate.sensor.health import Health

_LOADS = "0.5 1 2 4 8 4 2 1"


def calibrate_panel(app_state: AppState, viewer: Viewer) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        heading("1. Rest")
        paragraph(
            "What each pixel reads with nothing on it. Take everything off the sensor and "
            "leave it alone for some seconds; a gripper opens first."
        )
        rest = ui.button(
            "Take the rest values",
            on_click=lambda: viewer.order(CalibrateRest(file=app_state.calibration_file())),
            color=None,
        )
        rest.classes("btn plain").props("flat no-caps id=calibrate-rest")
        viewer.enable_when_allowed(rest, Action.CALIBRATE)
        heading("2. Force")
        _force(app_state, viewer)
        _result(app_state, viewer)


def _force(app_state: AppState, viewer: Viewer) -> None:
    how = ui.html("", sanitize=False)
    loads = ui.input("Loads in newtons, in order, up and down", value=_LOADS)
    loads.props("outlined dense")

    def start() -> None:
        """Order a calibration with the weights as typed, none where there is a load cell."""
        weights: tuple[float, ...] = ()
        source = app_state.session.devices.live.source
        if source is None or not source.has_load_cell:
            try:
                weights = tuple(check_loads(_numbers(loads.value), where="loads"))
            except InputError as error:
                viewer.refuse(error)
                return
        viewer.order(CalibrateForce(file=app_state.calibration_file(), loads_n=weights))

    button = ui.button("Calibrate the force", on_click=start, color=None)
    button.classes("btn plain").props("flat no-caps id=calibrate-force")
    viewer.enable_when_allowed(button, Action.CALIBRATE)

    def explain() -> None:
        """Show how newtons are measured on the rig that is open."""
        source = app_state.session.devices.live.source
        cell = source is not None and source.has_load_cell
        simulated = source is not None and source.simulated
        loads.set_visibility(not cell and not simulated)
        button.set_visibility(cell or not simulated)
        how.set_content(f"<p>{html.escape(_how(cell=cell, simulated=simulated))}</p>")

    viewer.on_refresh(explain)


def _how(*, cell: bool, simulated: bool) -> str:
    if cell:
        return (
            "A simulated load cell is put between the fingers six times, and the hand closes on it "
            "in steps. Its minutes run as fast as this machine can."
        )
    if simulated:
        return "The force of this simulated rig can't be calibrated: it has no load cell."
    return (
        "Lay dead weights on one pad as you are asked to, up and down again; each settles for "
        "20 s. Newtons are grams × 0.00981."
    )


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise InputError(f"loads {text!r}: numbers with spaces between them") from error


def _result(app_state: AppState, viewer: Viewer) -> None:
    box = ui.html("", sanitize=False).props("id=calibrated")
    shown: list[Calibrated | CalibrationFailure | None] = [None]

    def show() -> None:
        """Show how the last calibration ended, once."""
        devices = app_state.session.devices
        ended = devices.calibration_failure or devices.calibrated
        if ended is shown[0]:
            return
        shown[0] = ended
        match ended:
            case Calibrated():
                box.set_content(_table(ended))
            case CalibrationFailure():
                box.set_content(_failure(ended))

    viewer.on_refresh(show)


def _failure(failure: CalibrationFailure) -> str:
    kind, title = "bad", "Calibration failed"
    if failure.stopped:
        kind, title = "warn", "Calibration stopped"
    step = html.escape(f"At this step: {failure.step}") if failure.step else ""
    reason = html.escape(failure.reason)
    kept = "Nothing was written: the previous calibration stays in use, if there is one."
    return (
        f"<p class='result {kind}'>{title}</p>"
        + ("" if failure.stopped else f"<p class='finding fault'>{reason}</p>")
        + (f"<p>{step}</p>" if step else "")
        + f"<p>{kept}</p>"
    )


def _table(made: Calibrated) -> str:
    rows = "".join(
        f"<tr><td>{pixel_name(row, col)}</td><td class='r num'>{made.rest_ohm[row, col]:.0f}</td>"
        f"<td class='r num'>{number_text(made.change_percent[row, col], '+z.1f')} %</td></tr>"
        for row in range(made.rest_ohm.shape[0])
        for col in range(made.rest_ohm.shape[1])
    )
    errors = "".join(
        f"<tr><td>{force.removesuffix('_n')} N</td><td class='r num'>"
        f"{'not reached' if error is None else f'{error:.0f} %'}</td></tr>"
        for force, error in made.held_out.items()
    )
    force = (
        f"<p>Expected error of the settled force, loads left out of the fit:</p>"
        f"<table class='plain'>{errors}</table>"
    )
    return (
        f"<p class='result good'>Calibrated</p>"
        f"<p class='muted'>{html.escape(made.file.name)} was updated.</p>"
        + (force if errors else "")
        + "<table class='plain'><tr><th>pixel</th><th class='r'>rest, ohm</th>"
        + f"<th class='r'>change</th></tr>{rows}</table>"
    )


def doctor_panel(app_state: AppState, viewer: Viewer) -> None:
    """Fill the panel."""
    with ui.element("div").classes("form"):
        heading("Check of the sensor")
        paragraph(
            "Open, shorted, stuck, noisy and drifting pixels, lost frames, a reference "
            "resistor that does not fit. Nothing may touch the sensor for 10 s."
        )
        button = ui.button("Examine", on_click=lambda: viewer.order(Examine()), color=None)
        button.classes("btn plain").props("flat no-caps id=examine")
        viewer.enable_when_allowed(button, Action.EXAMINE)
        box = ui.html("", sanitize=False).props("id=health")
    shown: list[Health | None] = [None]

    def show() -> None:
        """Show a report when there is a new one."""
        health, source = app_state.session.devices.health, app_state.session.devices.live.source
        if health is None or health is shown[0] or source is None:
            return
        shown[0] = health
        box.set_content(report(health, layout=source.layout))

    viewer.on_refresh(show)


def report(health: Health, *, layout: ArrayLayout) -> str:
    """Return what was found as HTML."""
    faults = sum(found.severity is Severity.FAULT for found in health.findings)
    result = "Healthy" if health.healthy else count_of(faults, "fault")
    findings = "".join(
        f"<p class='finding {'fault' if found.severity is Severity.FAULT else ''}'>"
        f"<b>{html.escape(found.where)}</b>: {_sentence(found.text)} "
        f"{_sentence(found.check[:1].upper() + found.check[1:])}</p>"
        for found in health.findings
    )
    link = health.link
    counts = (
        f"{link.frames} frames in {link.duration_s:.1f} s, {link.rate_hz:.1f} Hz, "
        f"{link.lost} lost, {link.events.corrupt} corrupt, jitter "
        f"{link.jitter_percent:.1f} %"
    )
    ohm = " ohm"
    pixels = "".join(
        f"<tr><td>{pixel_name(row, col)}</td>"
        f"<td class='r num'>{_number(health.pixels.rest_ohm[row, col], ohm, 0)}</td>"
        f"<td class='r num'>{_number(health.pixels.noise_percent[row, col], ' %', 2)}</td>"
        f"<td class='r num'>{_number(health.pixels.drift_percent[row, col], ' %', 2)}</td></tr>"
        for row in range(layout.rows)
        for col in range(layout.cols)
    )
    return (
        f"<p class='result {'good' if health.healthy else 'bad'}'>{result}</p>{findings}"
        f"<p class='muted num'>{counts}</p><table class='plain'><tr><th>pixel</th>"
        f"<th class='r'>at rest</th><th class='r'>noise</th>"
        f"<th class='r'>drift</th></tr>{pixels}</table>"
    )


def _sentence(found: str) -> str:
    """Return words of a finding, which are written for a terminal, as HTML."""
    signed = re.sub(r"(?<!\w)-(?=\d)", "\N{MINUS SIGN}", html.escape(found))
    return re.sub("`([^`]+)`", r"<code>\1</code>", signed) + "."


def _number(value: float, unit: str, digits: int) -> str:
    return number_text(value, f"z.{digits}f") + unit if math.isfinite(value) else "open"
