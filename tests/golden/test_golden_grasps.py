"""A few seeded grasps on the twin, compared with stored results."""

from __future__ import annotations

import json
from typing import Any

import pytest
from tests.golden.grasps.generate import KEPT, goldens, run

STORED = json.loads(KEPT.read_text())


def near(kept: Any) -> Any:
    """Return a kept summary to compare with: numbers to the digits that are kept."""
    if isinstance(kept, dict):
        return {name: near(value) for name, value in kept.items()}
    if isinstance(kept, list):
        return [near(value) for value in kept]
    return pytest.approx(kept, rel=2e-3, abs=1e-3) if isinstance(kept, float) else kept


@pytest.mark.slow
@pytest.mark.parametrize("name", STORED)
def test_seeded_grasp_matches_stored_result(name: str) -> None:
    assert run(goldens()[name]) == near(STORED[name])
