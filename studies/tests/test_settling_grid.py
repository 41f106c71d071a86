"""Ours next to simpler rules: what the study prints, leaves out, learns and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer

from palpate.cli import run
from palpate.commands.study import SETTINGS, study
from palpate.settling.odds import LOG_ODDS
from palpate_studies import settling_grid, settling_odds
from palpate_studies.settling_families import after_baseline, draw


def ran(*arguments: object) -> int:
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.callback()(lambda: None)
    app.command(name="study", **SETTINGS)(study)
    return run(app, ["study", "settling-families", *map(str, arguments)], name="palpate")


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(settling_odds, "DRAWN", 2)
    lines = ["hold_id,time_s,value"]
    for specimen in "abc":
        for number, hold in enumerate(draw("power law", 2, seed=ord(specimen))):
            name = f"{specimen}_h0{number}"
            lines += [f"{name},{t},{v}" for t, v in zip(hold.time_s, hold.values, strict=True)]
    path = tmp_path / "holds.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_every_kind_next_to_every_rule(recording: Path, tmp_path: Path) -> None:
    assert ran("--holds", recording, "--count", 2, "--seed", 5, "--out", tmp_path / "out") == 0
    found = json.loads((tmp_path / "out" / "settling-families.json").read_text())
    families = list(settling_grid.FAMILIES)
    assert list(found["seen"]) == ["holds.csv", *families]
    assert list(found["left_out"]) == ["holds.csv a", "holds.csv b", "holds.csv c", *families]
    rules = [*settling_grid.SIMPLE, settling_grid.OURS]
    assert list(found["seen"]["bounce"]["median_abs_error_percent"]) == rules
    specimen = found["left_out"]["holds.csv a"]
    assert set(specimen["median_abs_error_percent"]) == {*rules, settling_grid.BEST}
    assert 0 <= specimen["relaxation"]["coverage"][0] <= 1
    text = (tmp_path / "out" / "settling-families.md").read_text()
    assert "no sensor, no twin" in text
    assert "seed 5" in text


def test_odds_that_are_learned_can_be_shipped(recording: Path, tmp_path: Path) -> None:
    module = tmp_path / "odds.py"
    assert ran("--holds", recording, "--odds", module) == 0
    learned: dict[str, np.ndarray] = {}
    exec(compile(module.read_text(), "odds.py", "exec"), learned)
    assert learned["LOG_ODDS"].shape == LOG_ODDS.shape


def test_a_baseline_in_front_moves_the_clock(recording: Path) -> None:
    holds = draw("exponential", 3, seed=1)
    plain = settling_grid.scores(holds, rivals=("recorded",))
    [hold] = draw("exponential", 1, seed=1)
    long = after_baseline(hold, rng=np.random.default_rng(0))
    start_s = float(long.time_s[len(long.time_s) - len(hold.time_s)])
    moved = settling_grid.scores([long], rivals=("recorded",), starts_s=[start_s])
    np.testing.assert_allclose(
        moved.errors["recorded"][:, 0], plain.errors["recorded"][:, 0], rtol=1e-6
    )


def test_contact_may_be_made_over_some_time() -> None:
    [hold] = draw("power law", 1, seed=3)
    made, at_once = (
        after_baseline(hold, rng=np.random.default_rng(1), rises_s=rises_s)
        for rises_s in (1.0, 0.0)
    )
    step_s = hold.time_s[1] - hold.time_s[0]
    further = made.values.size - at_once.values.size
    assert further == pytest.approx(1.0 / step_s, abs=1)
    before = len(made.values) - len(hold.values)
    rise = made.values[before - further : before]
    assert (np.diff(rise) < 0).all()
    assert made.values[0] > rise[0]
    assert rise[-1] > hold.values[0]


def test_the_best_simple_rule_is_chosen_on_others() -> None:
    def errors(recorded: float, exponential: float) -> dict[str, np.ndarray]:
        values = dict.fromkeys(settling_grid.SIMPLE, 9.0)
        values |= {"recorded": recorded, "exponential": exponential}
        return {name: np.full((3, 2), value) for name, value in values.items()}

    one = settling_grid.Scores(errors=errors(1.0, 5.0), covered=np.ones((3, 2)), ok=np.ones((3, 2)))
    found = settling_grid._with_best(one, [errors(4.0, 2.0)])
    assert (found.errors[settling_grid.BEST] == 5.0).all()


def test_a_recording_must_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert ran() == 2
    assert "--holds FILE" in capsys.readouterr().err
