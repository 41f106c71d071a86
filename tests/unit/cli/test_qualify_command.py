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


def test_qualify_prints_agreement_ceiling_grades_and_effort(
    tmp_path: Path, palpate: Command
) -> None:
    file = write_readings(tmp_path / "readings.csv")
    shown = palpate("qualify", file, "--tolerance", "1", "--unit", "lbf", "--limit", "14").out
    assert shown.startswith("40 items, 80 paired readings")
    for words in (
        "limit of agreement",
        "maximum R squared of any instrument",
        "below 14",
        "cost of wrong grades",
        "grasps to average",
    ):
        assert words in shown


def test_qualify_json_contains_every_figure(tmp_path: Path, palpate: Command) -> None:
    file = write_readings(tmp_path / "readings.csv")
    document = palpate("qualify", file, "--json").document
    assert document["items"] == 40
    assert document["tolerance"] == pytest.approx(document["scatter"]["reference"]["within"])
    figure = document["figures"]["r_squared_ceiling"]
    assert figure["low"] < figure["value"] < figure["high"] < 1.0


@pytest.mark.slow
def test_qualify_report_does_not_overwrite_an_existing_file(
    tmp_path: Path, palpate: Command
) -> None:
    file, page = write_readings(tmp_path / "readings.csv"), tmp_path / "page.html"
    palpate("qualify", file, "--limit", "13", "--report", page)
    text = page.read_text()
    assert text.count("<svg") == 2
    assert "signature" in text
    assert "already exists" in palpate.refused("qualify", file, "--report", page)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--limit", "15", "--limit", "13"), "increasing order"),
        (("--tolerance", "0"), "--tolerance"),
        (("--limit", "14", "--cost", "1", "-1"), "costs must not be negative"),
        (("--cost", "5", "1"), "--cost requires --limit"),
    ],
)
def test_qualify_invalid_input_is_refused_in_one_line(
    tmp_path: Path, palpate: Command, arguments: tuple[str, ...], message: str
) -> None:
    file = write_readings(tmp_path / "readings.csv")
    assert message in palpate("qualify", file, *arguments, status=2).err


def test_qualify_too_few_items_reports_the_required_number(
    tmp_path: Path, palpate: Command
) -> None:
    error = palpate("qualify", write_readings(tmp_path / "few.csv", items=5), status=2).err
    assert "at least 8 are required" in error
