"""`palpate bench`."""

from __future__ import annotations

import json

from palpate.cli import build_app, run
from palpate_studies import settling_speed
from palpate_studies.settling_growth import growth
from palpate_studies.settling_speed import Plan

TINY = Plan(sizes=(1, 20), repeats=(2, 1), peer_holds=20, growth=(500, 5000))


def bench_with(arguments: list[str]) -> int:
    return run(build_app(), ["bench", *arguments], name="palpate")


def test_it_prints_one_json_document(monkeypatch, capsys) -> None:
    monkeypatch.setattr(settling_speed, "QUICK", TINY)
    assert bench_with(["settling", "--quick", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == {"speed", "agreement", "streaming", "growth", "notes"}
    timed = {(row["method"], row["holds"]) for row in document["speed"]}
    assert {("exponential", 20), ("relaxation", 1), ("scipy.optimize.curve_fit", 20)} <= timed
    assert all(row["holds_per_s"] > 0 for row in document["speed"])
    assert document["agreement"]["p99_relative_difference"] < 1e-5
    assert {row["channels"] for row in document["streaming"]} == {8, 12}
    sizes = {row["method"]: row["holds"] for row in document["growth"]}
    assert set(sizes) == {"exponential", "relaxation", "matrix product", "reading the samples"}
    assert set(sizes.values()) == {5000}


def test_memory_grows_with_the_result_alone() -> None:
    few, many = (
        row["peak_beyond_input_mb"] - 2 * row["result_mb"]
        for row in growth((8192, 65_536), holds=settling_speed.synthetic_holds, cutoff_s=2.5)
        if row["method"] == "relaxation"
    )
    assert many < 1.1 * few


def test_people_read_tables_and_that_the_holds_are_simulated(monkeypatch, capsys) -> None:
    monkeypatch.setattr(settling_speed, "QUICK", TINY)
    monkeypatch.setattr(settling_speed, "_lmfit_fitter", lambda: None)
    assert bench_with(["settling", "--quick"]) == 0
    shown = capsys.readouterr().out
    assert "Simulated holds" in shown
    assert "lmfit is not installed" in shown


def test_an_unknown_benchmark_names_those_there_are(capsys) -> None:
    assert bench_with(["warp"]) == 2
    assert "no benchmark 'warp'; there are: settling" in capsys.readouterr().err


def test_help_shows_an_example(capsys) -> None:
    assert bench_with(["settling", "--help"]) == 0
    assert "palpate bench settling --quick" in capsys.readouterr().out
