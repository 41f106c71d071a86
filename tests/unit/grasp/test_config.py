"""Tuned numbers of the grasp are in its configuration, described, and nowhere else."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from palpate import grasp
from palpate.grasp.config import GROUPS, rows

FOLDER = Path(grasp.__file__).parent
#: Files of the loop: all that decide on a frame.
LOOP = (
    "answers",
    "approach",
    "controller",
    "current_monitor",
    "estimator",
    "monitors",
    "pixel_monitor",
    "rest",
    "runner",
    "safety_filter",
    "servo_evidence",
    "settle",
    "state",
    "step_size",
    "sweep",
    "tracking_monitor",
)
#: Numbers of arithmetic: counts of a few, halves, percent, digits, and the variance of a uniform.
PLAIN = {0, 1, 2, 3, 5, 6, 12, 100, 0.5}
#: Other numbers in the code that no measurement depends on: tolerances of arithmetic, the poll of
#: an opening hand, ends of a search, the size of a buffer, the median of a squared normal variable.
FIXED = {
    "answers": {1e-3},
    "estimator": {1e-3, 6000},
    "runner": {0.02},
    "safety_filter": {1e-9},
    "servo_evidence": {200.0, 0.05},
    "sweep": {0.4549},
}


@pytest.mark.parametrize("name", LOOP)
def test_loop_module_contains_no_tuned_number(name: str) -> None:
    tree = ast.parse((FOLDER / f"{name}.py").read_text())
    numbers = {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and type(node.value) in (int, float)
    }
    assert numbers <= PLAIN | FIXED.get(name, set())


def test_tuned_numbers_are_described_and_within_range() -> None:
    described = rows()
    assert len({row[0] for row in described}) == len(described)
    assert 0 < len(described) <= 81, "each tuned number must affect a visible result"
    assert set(GROUPS) == {row[0].split(".")[0] for row in described}
    for name, value, span, unit, source, quantity in described:
        low, high = map(float, span.split(" to "))
        assert low <= float(value) <= high, name
        assert unit, name
        kinds = ("paper", "datasheet", "requirement", "twin", "guess")
        assert source in kinds or source.startswith("study "), name
        assert quantity.endswith("."), name
