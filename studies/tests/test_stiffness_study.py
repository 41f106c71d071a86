"""The stiffness study: its objects, scores and repeatability."""

from __future__ import annotations

import math

import pytest

from palpate.twin.mechanics import object_force_n
from palpate_studies.stiffness import (
    FIRM_N,
    SIZES_MM,
    StiffnessAnswer,
    draw_stiffness_object,
    repeat_grasps,
    scores,
)


@pytest.mark.parametrize("stiffness", [0.5, 5.0, 50.0])
def test_draw_stiffness_object_has_requested_secant_stiffness(stiffness: float) -> None:
    drawn = [draw_stiffness_object(stiffness, seed=seed) for seed in range(12)]
    for obj in drawn:
        force_n = object_force_n(obj, FIRM_N / stiffness, ruptured=False)[0]
        assert force_n == pytest.approx(FIRM_N)
        assert SIZES_MM[0] <= obj.size_mm <= SIZES_MM[1]
    assert {obj.contact for obj in drawn} == {"linear", "hertz"}
    assert min(sum(obj.relaxing_fractions) for obj in drawn) < 0.05
    assert max(sum(obj.relaxing_fractions) for obj in drawn) > 0.1


def test_scores_count_bounds_including_rigid_objects() -> None:
    """Every wide interval is reported as a bound; only some include rigid objects."""
    wide, unbounded = (
        StiffnessAnswer(
            gripper="soft",
            level="lab",
            squeeze="gentle",
            truth=2.0,
            value=1.0,
            low=0.5,
            high=high,
            status="at_least",
            firmness=33.0,
        )
        for high in (2.5, 500.0)
    )
    found = scores([wide, unbounded, unbounded])
    assert found["no_upper_end"] == 2
    assert found["median_abs_error_percent"] is None, "no error without upper limits"
    assert scores([wide, wide, unbounded])["median_abs_error_percent"] == pytest.approx(50.0)


def test_firmness_rank_uses_every_grasp_with_firmness() -> None:
    answers = [
        StiffnessAnswer(
            gripper="rigid",
            level="lab",
            squeeze="gentle",
            truth=truth,
            value=value,
            low=0.5 * truth,
            high=2.0 * truth,
            status="ok",
            firmness=firmness,
        )
        for truth, value, firmness in (
            (1.0, 1.0, 33.0),
            (2.0, math.nan, 45.0),
            (4.0, 4.0, 40.0),
            (8.0, 8.0, math.nan),
            (9.0, 9.0, 66.0),
        )
    ]
    found = scores(answers)
    assert found["with_firmness"] == 4
    assert found["firmness_rank"] == pytest.approx(0.8)


@pytest.mark.slow
def test_repeat_grasps_of_one_object_vary_little() -> None:
    found = repeat_grasps("lab", seed=700, stiffness=4.0, gripper="rigid", grasps=3)
    assert found["grasps"] == 3
    assert 0.0 < found["sd"] < 6.0
