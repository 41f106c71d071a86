"""A few seeded grasps on the twin, compared with stored results."""

from __future__ import annotations

import json

import pytest
from tests.golden.grasps.generate import KEPT, goldens, run
from tests.golden.near import near

STORED = json.loads(KEPT.read_text())


@pytest.mark.slow
@pytest.mark.parametrize("name", STORED)
def test_seeded_grasp_matches_stored_result(name: str) -> None:
    assert run(goldens()[name]) == near(STORED[name])
