"""The ladder study on synthetic ladders."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

LOADS_N = [0.0, 0.6, 1.2, 1.1, 1.6, 2.0, 3.0, 4.0, 6.0, 9.0]


def ladder_csv(path: Path, names: str) -> Path:
    """Write synthetic ladders, one per letter of `names`, with random gain and exponent."""
    lines = ["ladder,step,load_n,resistance_ohm,spread_ohm"]
    for name in names:
        rng = np.random.default_rng(ord(name))
        exponent, gain = rng.normal(1.1, 0.2), rng.normal(-3.5, 0.5)
        for step, load_n in enumerate(LOADS_N):
            excess = np.exp(gain) * load_n**exponent * np.exp(0.1 * rng.standard_normal())
            lines.append(f"{name},{step},{load_n},{1 / (0.001 + excess):.4f},0.1")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_force_ladders_with_test_ladders_scores_only_these(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    known, tested = ladder_csv(tmp_path / "a.csv", "AB"), ladder_csv(tmp_path / "b.csv", "C")
    found = document("force-ladders", "--ladders", known, "--test-ladders", tested)
    assert {row["ladder"] for row in found["rows"]} == {"C"}


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
