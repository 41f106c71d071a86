"""`palpate qualify`: tables, JSON document and report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.commands import Command


def write_readings(path: Path, *, items: int = 40) -> Path:
    random = np.random.default_rng(1)
    lines = ["item_id,side,reference,grasp"]
    for item in range(items):
        firmness = random.normal(14.0, 2.0)
        for side in ("left", "right"):
            reference = firmness + random.normal(0.0, 1.0)
            lines.append(f"A{item},{side},{reference:.2f},{3 * firmness + random.normal():.2f}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.slow
def test_qualify_prints_and_reports_every_figure(tmp_path: Path, palpate: Command) -> None:
    file, page = write_readings(tmp_path / "readings.csv"), tmp_path / "page.html"
    options = ("--tolerance", "1", "--unit", "lbf", "--limit", "14")
    shown = palpate("qualify", file, *options, "--report", page).out
    assert shown.startswith("40 items, 80 paired readings")
    for words in ("limit of agreement", "maximum R squared", "below 14", "grasps to average"):
        assert words in shown
    assert page.read_text().count("<svg") == 2
    assert "already exists" in palpate.refused("qualify", file, "--report", page)
    document = palpate("qualify", file, "--json").document
    assert document["items"] == 40
    assert document["tolerance"] == pytest.approx(document["scatter"]["reference"]["within"])
    figure = document["figures"]["r_squared_ceiling"]
    assert figure["low"] < figure["value"] < figure["high"] < 1.0
