"""Learners that are given everything, next to our line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import build_app, run
from palpate.estimate.damage_learning import FruitClosing, follow_closing
from palpate_studies.rupture_learners import features, learned_scores, learners


def spring(name: str, *, stiffness: float, limit_n: float, size_mm: float = 0.0) -> FruitClosing:
    closure_mm = np.arange(0.0, 1.2 * limit_n / stiffness, 0.01)
    return follow_closing(
        name,
        fruit="spring",
        rupture_force_n=limit_n,
        closure_mm=size_mm + closure_mm,
        force_n=stiffness * closure_mm,
    )


def test_a_spring_shows_its_stiffness_and_nothing_else() -> None:
    shown = features(spring("s", stiffness=3.0, limit_n=9.0, size_mm=40.0))
    assert shown.shape[1] == 10
    last = shown[-1]
    assert last[0] == pytest.approx(np.log(3.0), abs=1e-3)
    assert last[1:5] == pytest.approx(0.0, abs=1e-3)
    assert last[6] == 0.0
    assert last[8] == 40.0
    assert np.all(np.diff(shown[:, 9]) > 0)


def test_what_comes_later_shows_nothing_of_itself_before() -> None:
    whole = spring("s", stiffness=3.0, limit_n=9.0)
    bent = follow_closing(
        "s",
        fruit="spring",
        rupture_force_n=9.0,
        closure_mm=np.arange(0.0, 6.0, 0.01),
        force_n=np.minimum(3.0 * np.arange(0.0, 6.0, 0.01), 6.0 + 0.3 * np.arange(0.0, 6.0, 0.01)),
    )
    both = min(np.sum(whole.force_n < 5.5), np.sum(bent.force_n < 5.5))
    assert both > 20
    assert features(whole)[:both] == pytest.approx(features(bent)[:both])


@pytest.mark.parametrize("name", list(learners()))
def test_a_learner_finds_what_our_line_can_not_see(name: str) -> None:
    rng, closings = np.random.default_rng(2), []
    for number in range(60):
        stiffness, size_mm = float(rng.uniform(2, 8)), float(rng.uniform(30, 60))
        closings.append(
            spring(f"s{number}", stiffness=stiffness, limit_n=0.2 * size_mm, size_mm=size_mm)
        )
    shown = {closing.grasp_id: features(closing) for closing in closings}
    scored = learned_scores(
        learners()[name], training=closings[:45], test=closings[45:], shown=shown
    )
    missed = []
    for closing, one in zip(closings[45:], scored, strict=True):
        half = int(np.argmax(one.score >= 0.5))
        missed.append(abs(one.force_n[half] / one.score[half] / closing.rupture_force_n - 1))
    assert np.mean(missed) < 0.12


def test_on_real_fruit_no_learner_is_much_nearer_than_our_line(
    real_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [
        *("--curves", str(real_data / "fruit_rupture.csv.gz")),
        *("--index", str(real_data / "fruit_rupture_index.csv")),
    ]
    assert run(build_app(), ["study", "rupture-limits", *files, "--json"], name="palpate") == 0
    firmness = {
        entry["method"]: entry["firmness"]
        for entry in json.loads(capsys.readouterr().out)["tradeoff"]
        if (entry["fruit"], entry["rate_limit"]) == ("all", 0.05)
    }
    learned = [firmness[name] for name in firmness if name.endswith("told everything")]
    assert len(learned) == 2
    assert firmness["ours"] > max(learned) - 0.01
    assert firmness["ours"] > firmness["rule as published"] + 0.05
