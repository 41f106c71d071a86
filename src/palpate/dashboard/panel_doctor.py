"""The panel that examines the sensor."""

from __future__ import annotations

import html
import math
import re

from nicegui import ui

from palpate.dashboard.activity import Action
from palpate.dashboard.app_state import AppState
from palpate.dashboard.html_parts import count_of, heading, number_text, paragraph
from palpate.dashboard.orders import Examine
from palpate.dashboard.viewer import Viewer
from palpate.sensor.array import ArrayLayout
from palpate.sensor.findings import Severity, pixel_name
from palpate.sensor.health import Health


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
