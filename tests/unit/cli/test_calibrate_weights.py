"""Dead weights: interval widths after each weight, and the end of the series."""

from __future__ import annotations

import pytest

from palpate.cli.calibrate_force import WeightSeries, _iterate_until_tolerance, _prompt_for_loads


def test_calibrate_force_each_weight_reports_the_interval_widths(
    capsys: pytest.CaptureFixture[str],
) -> None:
    series = WeightSeries(tolerance_percent=0.0)
    for load_n in (1.5, 4.0, 9.0):
        series.add(8.0 * load_n**1.2, load_n)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("1.5 N measured; half-width of the interval: ")
    assert "most useful next" in lines[0]
    document = series.to_dict()
    assert set(document) == {"1.5_n", "4_n", "9_n"}
    assert all(each["after"] < 0.5 * each["before"] for each in document.values())


def test_calibrate_force_stops_prompting_within_the_tolerance() -> None:
    series, placed = WeightSeries(tolerance_percent=80.0), list[float]()
    for load_n in _iterate_until_tolerance([1.5, 4.0, 9.0, 6.0, 2.0], series):
        placed.append(load_n)
        series.add(8.0 * load_n**1.2, load_n)
    assert placed == [1.5, 4.0, 9.0]


def test_calibrate_force_mistyped_weight_is_requested_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = iter(["1.5", "4,0", "-4", "408", "4", "9", ""])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(typed))
    assert list(_prompt_for_loads(WeightSeries(tolerance_percent=0.0))) == [1.5, 4.0, 9.0]
    errors = capsys.readouterr().err.splitlines()
    assert [line.split(": ", 1)[0] for line in errors] == ["load '4,0'", "load '-4'", "load '408'"]
