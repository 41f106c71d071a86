"""`palpate qualify`: the table, the document and the page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import build_app, run


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


def qualify(*arguments: str) -> int:
    return run(build_app(), ["qualify", *arguments], name="palpate")


def test_qualify_prints_agreement_ceiling_grades_and_effort(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_readings(tmp_path / "readings.csv")
    assert qualify(str(file), "--tolerance", "1", "--unit", "lbf", "--limit", "14") == 0
    shown = capsys.readouterr().out
    assert shown.startswith("40 items, 80 paired readings")
    for words in (
        "limit of agreement",
        "no instrument can pass",
        "below 14",
        "cost of wrong grades",
        "grasps that average",
    ):
        assert words in shown


def test_qualify_json_holds_every_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_readings(tmp_path / "readings.csv")
    assert qualify(str(file), "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["items"] == 40
    assert document["tolerance"] == pytest.approx(document["scatter"]["reference"]["within"])
    figure = document["figures"]["r_squared_ceiling"]
    assert figure["low"] < figure["value"] < figure["high"] < 1.0


@pytest.mark.slow
def test_qualify_report_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, page = write_readings(tmp_path / "readings.csv"), tmp_path / "page.html"
    assert qualify(str(file), "--limit", "13", "--report", str(page)) == 0
    text = page.read_text()
    assert text.count("<svg") == 2
    assert "signature" in text
    capsys.readouterr()
    assert qualify(str(file), "--report", str(page)) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--limit", "15", "--limit", "13"), "rising order"),
        (("--tolerance", "0"), "--tolerance"),
        (("--limit", "14", "--cost", "1", "-1"), "a cost is 0 or more"),
    ],
)
def test_qualify_refuses_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    message: str,
) -> None:
    file = write_readings(tmp_path / "readings.csv")
    assert qualify(str(file), *arguments) == 2
    assert message in capsys.readouterr().err


def test_qualify_too_few_items_says_how_many_it_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert qualify(str(write_readings(tmp_path / "few.csv", items=5))) == 2
    assert "needs at least 8" in capsys.readouterr().err
