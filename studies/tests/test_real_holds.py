"""The real-holds study: what it prints, what it holds out, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from tests.pdf_fonts import check_fonts

from palpate.cli import run
from palpate.commands.study import SETTINGS, study


def ran(*arguments: object) -> int:
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.callback()(lambda: None)
    app.command(name="study", **SETTINGS)(study)
    return run(app, ["study", "real-holds", *map(str, arguments)], name="palpate")


def written(folder: Path, names: list[str]) -> Path:
    random = np.random.default_rng(5)
    lines = ["hold_id,time_s,value"]
    for name in names:
        time_s = np.arange(0, 21, 0.25)
        values = 100 - random.uniform(2, 6) * np.log(time_s + 0.4)
        values += 0.05 * random.normal(size=time_s.size)
        lines += [f"{name},{t},{v:.4f}" for t, v in zip(time_s, values, strict=True)]
    path = folder / "holds.csv"
    path.write_text("\n".join(lines) + "\nbrief_h00,0,1\n")
    return path


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, Path]:
    folder = tmp_path_factory.mktemp("real")
    path = written(folder, [f"{specimen}_h0{n}" for specimen in "abc" for n in range(3)])
    assert ran("--holds", path, "--out", folder / "report") == 0
    return json.loads((folder / "report" / "real-holds.json").read_text()), folder / "report"


def test_every_method_at_every_cutoff(report: tuple[dict, Path]) -> None:
    [file] = report[0]["files"]
    assert report[0]["origin"] == "real recordings"
    assert (file["holds"], file["specimens"], file["left_out_unit"]) == (
        9,
        ["a", "b", "c"],
        "specimen",
    )
    methods = [
        "recorded",
        "exponential",
        "log_law",
        "log_law_early",
        "best simple",
        "relaxation",
        "calibrated",
    ]
    assert list(dict.fromkeys(entry["method"] for entry in file["summary"])) == methods
    assert [e["cutoff_s"] for e in file["summary"][:8]] == [1, 2, 2.5, 3, 5, 8, 10, 15]
    assert all(entry["holds"] == 9 for entry in file["summary"])
    ours = [e for e in file["summary"] if e["method"] == "relaxation"]
    for entry in ours:
        low, high = entry["median_abs_error_percent_interval"]
        assert low <= entry["median_abs_error_percent"] <= high
        assert 0 <= entry["coverage"] <= 1
    assert len(file["per_specimen"]) == 3 * 7
    assert len(file["worst"]) == 9
    errors = [abs(entry["error_percent"]) for entry in file["worst"]]
    assert errors == sorted(errors, reverse=True)
    assert 0 <= file["limits"]["between_specimens_percent"] <= 100


def test_report_says_what_is_real_and_shows_every_baseline(report: tuple[dict, Path]) -> None:
    text = (report[1] / "real-holds.md").read_text()
    assert "Real recordings, nothing simulated: holds.csv, 9 holds of 3 specimen(s)" in text
    for method in ("recorded", "log_law_early", "best simple", "relaxation", "calibrated"):
        assert f"| {method} |" in text
    for stem in ("errors_1", "worst_1"):
        assert (report[1] / f"{stem}.png").read_bytes().startswith(b"\x89PNG")
        check_fonts(report[1] / f"{stem}.pdf")


def test_few_specimens_are_held_out_hold_by_hold(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, ["a_h00", "a_h01", "a_h02"])
    assert ran("--holds", path, "--json") == 0
    [file] = json.loads(capsys.readouterr().out)["files"]
    assert (file["left_out_unit"], file["specimens"]) == ("hold", ["a"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "--holds FILE"),
        (["--holds", "nowhere.csv"], "nowhere.csv: no such file"),
        (["--specimen-pattern", "("], "--specimen-pattern ("),
        (["--specimen-pattern", "z"], "is not found in hold a_h00"),
    ],
)
def test_bad_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    if "--specimen-pattern" in arguments:
        arguments = [*arguments, "--holds", str(written(tmp_path, ["a_h00"]))]
    assert ran(*arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert said in captured.err


def test_holds_that_all_end_early_cannot_be_scored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ran("--holds", written(tmp_path, [])) == 2
    assert "no hold reaches 20 s" in capsys.readouterr().err
