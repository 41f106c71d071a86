"""The grasp cycle study: its scores, and one object grasped with every method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_studies.grasp_cycle import (
    Cycle,
    Sample,
    judge,
    scores,
)

SAMPLE = Sample(seed=31_000, level="lab", kind="rigid")
CYCLE = Cycle(
    sample=SAMPLE,
    method="ours",
    outcome="held",
    touch_s=4.0,
    answer_s=8.0,
    touch_peak_n=1.0,
    peak_n=3.0,
    damaged=False,
    size_error_mm=0.3,
    force_error=-0.1,
    stiffness=2.0,
    stiffness_low=1.5,
    stiffness_high=3.0,
    true_stiffness=2.5,
    stiffness_status="ok",
)


def test_scores_separate_stiffness_numbers_and_bounds() -> None:
    bound = replace(
        CYCLE,
        answer_s=12.0,
        size_error_mm=-0.4,
        stiffness=np.nan,
        stiffness_low=3.0,
        stiffness_high=np.nan,
        stiffness_status="at_least",
    )
    found = scores([CYCLE, bound, replace(bound, true_stiffness=9.0)])
    assert found["stiffness_numbers"] == 1
    assert found["stiffness_median_error"] == pytest.approx(0.2)
    assert found["stiffness_median_ratio"] == 2.0
    assert found["stiffness_coverage"] == 1.0
    assert (found["stiffness_bounds"], found["stiffness_bounds_right"]) == (2, 0.5)
    assert found["answer_s_median"] == 12.0
    assert found["size_rms_mm"] == pytest.approx(np.sqrt((0.09 + 0.16 + 0.16) / 3))


def test_judge_compares_damage_on_same_objects() -> None:
    """Of four objects on two sensors, the baseline damages two more."""
    found = list[Cycle]()
    for number in range(4):
        ours_on_it = replace(CYCLE, sample=replace(SAMPLE, seed=31_000 + 2 * number))
        found += [ours_on_it, replace(ours_on_it, method="plain", damaged=number in (1, 2))]
    report = judge(found)
    (row,) = report.payload["compared"]
    assert (row["rival"], row["difference"]) == ("plain", -0.5)
    assert row["low"] <= -0.5 <= row["high"]
    assert report.tables[-1].rows[0][3] == "-0.5"
    alone = [one for one in found if one.sample.sheet == SAMPLE.sheet]
    assert judge(alone).tables[-1].rows[0][4:] == ["-", "-"]
    # A baseline that did not grasp all objects is not compared.
    assert judge(found[:-1]).payload["compared"] == []
