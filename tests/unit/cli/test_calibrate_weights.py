"""Dead weights on the command line: gain of each, and when to stop."""

from __future__ import annotations

import pytest

from palpate.cli.calibrate_force import WeightSeries, _iterate_until_tolerance, _prompt_for_loads
from palpate.errors import InputError


def course(tolerance_percent: float = 0.0) -> WeightSeries:
    return WeightSeries(tolerance_percent=tolerance_percent)


def test_calibrate_force_each_weight_reports_the_interval_widths(
    capsys: pytest.CaptureFixture[str],
) -> None:
    weights = course()
    for load_n in (1.5, 4.0, 9.0):
        weights.add(8.0 * load_n**1.2, load_n)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("1.5 N measured; half-width of the interval: ")
    assert "most useful next" in lines[0]
    document = weights.to_dict()
    assert set(document) == {"1.5_n", "4_n", "9_n"}
    assert all(each["after"] < 0.5 * each["before"] for each in document.values())


def test_calibrate_force_stops_prompting_within_the_tolerance() -> None:
    weights, laid = course(80.0), list[float]()
    for load_n in _iterate_until_tolerance([1.5, 4.0, 9.0, 6.0, 2.0], weights):
        laid.append(load_n)
        weights.add(8.0 * load_n**1.2, load_n)
    assert laid == [1.5, 4.0, 9.0]


def test_calibrate_force_empty_line_ends_typed_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    typed = iter(["9", "1.5", "4", ""])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(typed))
    assert list(_prompt_for_loads(course())) == [9.0, 1.5, 4.0]


def test_calibrate_force_too_few_typed_weights_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    typed = iter(["1.5", "4", ""])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(typed))
    with pytest.raises(InputError, match="at least 3"):
        list(_prompt_for_loads(course()))


def test_calibrate_force_mistyped_weight_is_requested_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = iter(["1.5", "4,0", "-4", "408", "4", "9", ""])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(typed))
    assert list(_prompt_for_loads(course())) == [1.5, 4.0, 9.0]
    said = capsys.readouterr().err.splitlines()
    assert [line.split(": ", 1)[0] for line in said] == ["load '4,0'", "load '-4'", "load '408'"]
    assert "type newtons" in said[0]
    assert "0 or more" in said[1]
    assert "grams" in said[2]
