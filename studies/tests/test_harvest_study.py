"""The study of pulls on held fruit."""

from __future__ import annotations

import pytest

from palpate_studies.harvest import FIRST_SEED, PULLS_N, judge, judge_pulls


@pytest.mark.slow
def test_pull_beyond_friction_slips_and_is_not_secure() -> None:
    found = judge_pulls(FIRST_SEED - 4, level="lab")
    assert [one["pull_n"] for one in found] == list(PULLS_N)
    assert not any(one["slipped"] for one in found if one["verdict"] == "secure to pull")
    slipped = [one["slipped"] for one in found]
    assert slipped == sorted(slipped)
    rows = judge(found).payload["summary"]
    assert sum(row["pulls"] for row in rows) == len(PULLS_N)
