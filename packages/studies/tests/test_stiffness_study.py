"""Scores of the studies of stiffness and size, from known errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.measurement import Measurement
from palpate_studies import size
from palpate_studies.size import SizedStrawberry
from palpate_studies.stiffness import StiffnessAnswer, scores


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


def measured(value: float, half: float = 0.3) -> Measurement:
    return Measurement(value=value, low=value - half, high=value + half, unit="mm")


def test_size_scores_of_known_errors_are_exact() -> None:
    berries = [
        SizedStrawberry(
            sensor=0,
            true_mm=35.0,
            published_mm=published,
            same_steps=measured(ours),
            damaged=number == 0,
            pressed_to_mm=33.5,
            steps=np.zeros(3),
        )
        for number, (published, ours) in enumerate([(36.0, 35.1), (34.0, 35.5), (35.0, 34.9)])
    ]
    published, ours = size.scores(berries, "published"), size.scores(berries, "same_steps")
    assert published["rms_mm"] == pytest.approx(np.sqrt(2 / 3))
    assert published["within_1_mm"] == 1.0
    assert ours["coverage"] == pytest.approx(2 / 3)
    assert ours["worst_mm"] == pytest.approx(0.5)
    assert ours["damaged"] == 1
    # With one sensor there is no training set.
    assert size.scores(berries, "trees")["answered"] == 0
