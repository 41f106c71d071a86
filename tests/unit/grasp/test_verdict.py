"""Verdict of a grasp: firmness in words, or its index for an unknown stiffness."""

from __future__ import annotations

import pytest

from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.verdict import verdict
from palpate.measurement import Measurement
from palpate.object.firmness import firmness_index


@pytest.mark.parametrize(
    ("low", "high", "words"), [(1.2, 2.9, "soft"), (0.7, 40.0, "firmness 28 to 87 of 100")]
)
def test_verdict_gives_firmness_as_word_or_index(low: float, high: float, words: str) -> None:
    stiffness = Measurement(value=2.0, low=low, high=high, unit="n_per_mm", level=0.9)
    result = GraspResult(
        outcome=Outcome.HELD, stiffness_n_per_mm=stiffness, firmness=firmness_index(stiffness)
    )
    assert verdict(result, target_force_n=None)["firmness"] == words
