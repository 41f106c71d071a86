"""Seeded grasps on the twin, with and without faults, compared with stored results."""

from __future__ import annotations

import json
from typing import Any

import pytest
from tests.golden.grasps.generate import KEPT, SHEETS, Case, cases, run

ALL = cases()
#: Two sensors, so that plain pytest calibrates only those.
QUICK = [
    case
    for case in ALL
    if case.seed % len(SHEETS) == 0
    and (case.kind, case.level) in {("rigid", "lab"), ("soft", "field")}
][::3]


def near(kept: Any) -> Any:
    """Return a kept summary to compare with: numbers to the digits that are kept."""
    if isinstance(kept, dict):
        return {name: near(value) for name, value in kept.items()}
    if isinstance(kept, list):
        return [near(value) for value in kept]
    return pytest.approx(kept, rel=2e-3, abs=1e-3) if isinstance(kept, float) else kept


def check(case: Case) -> None:
    kept = json.loads(KEPT.read_text())[case.name]
    assert run(case) == near(kept)


@pytest.mark.slow
@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.name)
def test_quick_seeded_grasp_matches_stored_result(case: Case) -> None:
    check(case)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [case for case in ALL if case not in QUICK], ids=lambda case: case.name
)
def test_remaining_seeded_grasp_matches_stored_result(case: Case) -> None:
    check(case)
