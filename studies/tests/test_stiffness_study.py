"""The stiffness study: its objects, scores and repeatability."""

from __future__ import annotations

import math

import pytest

from palpate_studies.stiffness import (
    StiffnessAnswer,
    scores,
)


def answer(
    truth: float, value: float, *, high: float | None = None, firmness: float = 33.0
) -> StiffnessAnswer:
    return StiffnessAnswer(
        gripper="rigid",
        level="lab",
        squeeze="gentle",
        truth=truth,
        value=value,
        low=0.5 * truth,
        high=2.0 * truth if high is None else high,
        status="ok" if high is None else "at_least",
        firmness=firmness,
    )


def test_scores_count_bounds_including_rigid_objects() -> None:
    """Every wide interval is reported as a bound; only some include rigid objects."""
    wide, unbounded = answer(2.0, 1.0, high=2.5), answer(2.0, 1.0, high=500.0)
    found = scores([wide, unbounded, unbounded])
    assert found["no_upper_end"] == 2
    assert found["median_abs_error_percent"] is None, "no error without upper limits"
    assert scores([wide, wide, unbounded])["median_abs_error_percent"] == pytest.approx(50.0)


def test_firmness_rank_uses_every_grasp_with_firmness() -> None:
    found = scores(
        [
            answer(1.0, 1.0),
            answer(2.0, math.nan, firmness=45.0),
            answer(4.0, 4.0, firmness=40.0),
            answer(8.0, 8.0, firmness=math.nan),
            answer(9.0, 9.0, firmness=66.0),
        ]
    )
    assert found["with_firmness"] == 4
    assert found["firmness_rank"] == pytest.approx(0.8)
