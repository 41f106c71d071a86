"""The ladder study on synthetic and real ladders."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

LOADS_N = [0.0, 0.6, 1.2, 1.1, 1.6, 2.0, 3.0, 4.0, 6.0, 9.0]


def ladder_csv(path: Path, names: str, *, loads_n: list[float] = LOADS_N) -> Path:
    """Write synthetic ladders, one per letter of `names`, with random gain and exponent."""
    lines = ["ladder,step,load_n,resistance_ohm,spread_ohm"]
    for name in names:
        rng = np.random.default_rng(ord(name))
        exponent, gain = rng.normal(1.1, 0.2), rng.normal(-3.5, 0.5)
        for step, load_n in enumerate(loads_n):
            excess = np.exp(gain) * load_n**exponent * np.exp(0.1 * rng.standard_normal())
            lines.append(f"{name},{step},{load_n},{1 / (0.001 + excess):.4f},0.1")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_force_ladders_json_has_every_scored_step_and_model(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    found = document("force-ladders", "--ladders", ladder_csv(tmp_path / "a.csv", "ABC"))
    assert len(found["rows"]) == 3 * 4 * 6
    assert {row["ladder"] for row in found["rows"]} == {"A", "B", "C"}
    assert {row["load_n"] for row in found["rows"]} == {0.6, 1.2, 1.1, 2.0, 3.0, 6.0}
    assert {one["model"] for one in found["summary"]} == {"line", "power", "pooled", "ours"}


def test_ladder_predictions_depend_only_on_given_weights_and_other_ladders(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    path = ladder_csv(tmp_path / "a.csv", "ABX")
    other = tmp_path / "y.csv"
    other.write_text(re.sub(r"X,(\d),6\.0,", r"X,\1,7.0,", path.read_text()))
    answers = []
    for ladders in (path, other):
        found = document("force-ladders", "--ladders", ladders)["rows"]
        rows = [row for row in found if row["ladder"] == "X"]
        answers.append([row["predicted_n"] for row in rows])
    assert answers[0] == answers[1]


def test_force_law_on_real_ladders_beats_power_and_pooled_laws(
    real_data: Path, document: Callable[..., Any]
) -> None:
    ladders = real_data / "velostat_force_ladders.csv"
    found = document("force-ladders", "--ladders", ladders)
    error = {(one["ladder"], one["model"]): one["median_abs_log_ratio"] for one in found["summary"]}
    names = {name for name, _ in error}
    ours, power, pooled = (
        np.mean([error[name, model] for name in names]) for model in ("ours", "power", "pooled")
    )
    assert ours <= 0.25
    assert ours < 0.8 * power < 0.8 * pooled
    covered = [
        row["low_n"] <= row["load_n"] <= row["high_n"]
        for row in found["rows"]
        if row["model"] == "ours"
    ]
    assert 0.8 <= np.mean(covered) <= 0.97


def test_force_ladders_with_test_ladders_scores_only_these(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    known, tested = ladder_csv(tmp_path / "a.csv", "AB"), ladder_csv(tmp_path / "b.csv", "C")
    found = document("force-ladders", "--ladders", known, "--test-ladders", tested)
    assert {row["ladder"] for row in found["rows"]} == {"C"}
