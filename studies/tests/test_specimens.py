"""Specimens from the names of holds."""

from __future__ import annotations

import re

import pytest

from palpate.errors import InputError
from palpate_studies.specimens import specimen_of


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
