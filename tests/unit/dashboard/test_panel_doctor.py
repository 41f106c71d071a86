"""The examination report on the page, with the same findings as in the terminal."""

from __future__ import annotations

import re

import numpy as np

from palpate.dashboard.panel_sensor import findings_html
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.health import FrameColumns, check_health


def test_findings_html_marks_commands_and_uses_minus_signs() -> None:
    counts = np.rint(np.random.default_rng(2).normal(300, 0.6, (150, 4, 2))).astype(np.int32)
    columns = FrameColumns(time_s=np.arange(150) / 15, sequence=np.arange(150), counts=counts)
    known_ohm = 1.01 * columns.rest_ohm(layout=RIGID_LAYOUT)
    known_ohm[1, 0] *= 2.0
    health = check_health(columns, layout=RIGID_LAYOUT, known_ohm=known_ohm)
    assert any("`palpate calibrate rest`" in one.check for one in health.findings)
    assert any(" -" in one.text for one in health.findings)
    shown = findings_html(health)
    assert "<code>palpate calibrate rest</code>" in shown
    assert "`" not in shown
    words = re.sub(r"<[^>]*>", "", shown)
    assert "\N{MINUS SIGN}" in words
    assert not re.search(r"(?<!\w)-\d", words)
