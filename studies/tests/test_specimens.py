"""Specimens from names, and that a hold is never predicted with its own specimen's help."""

from __future__ import annotations

import re

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.holds import Hold
from palpate.settling.recorded import Recorded
from palpate_studies.specimens import predict_held_out, specimen_of


@pytest.mark.parametrize(
    ("hold_id", "specimen"),
    [
        ("1_10_E4pin_20mm_v5_0.2Strain_velocityprof_h12", "1_10_E4pin"),
        ("1_10_Epin_20mm_v2_h01", "1_10_Epin"),
        ("test7_h00", "test"),
        ("12_h03", "12"),
        ("q15late_press_30s_15_a0_908d01", "q15late_press"),
        ("weight_0.1kg_81f67c", "weight"),
        ("20mm_h01", "20mm"),
        ("plain", "plain"),
    ],
)
def test_the_rule(hold_id: str, specimen: str) -> None:
    assert specimen_of(hold_id) == specimen


def test_a_pattern_takes_its_group_and_must_fit() -> None:
    pattern = re.compile(r"pad(\d)")
    assert specimen_of("left_pad3_h01", pattern=pattern) == "3"
    with pytest.raises(InputError, match="not found in hold other"):
        specimen_of("other", pattern=pattern)


def test_calibration_never_sees_the_specimen_it_predicts() -> None:
    holds = [
        Hold(hold_id=f"{s}{n}", channel=None, time_s=np.array([0.0, 20.0]), values=np.ones(2))
        for s in "abc"
        for n in range(2)
    ]
    seen: list[set[str]] = []

    def calibrate(others: list[Hold]) -> Recorded:
        seen.append({hold.hold_id for hold in others})
        return Recorded()

    rows = list(
        predict_held_out(
            holds,
            units=[hold.hold_id[0] for hold in holds],
            calibrate=calibrate,
            name="calibrated",
            cutoffs_s=[1.0],
            horizon_s=20.0,
            level=0.9,
        )
    )
    assert [row.hold_id for row in rows] == [hold.hold_id for hold in holds]
    assert seen == [{"b0", "b1", "c0", "c1"}, {"a0", "a1", "c0", "c1"}, {"a0", "a1", "b0", "b1"}]
