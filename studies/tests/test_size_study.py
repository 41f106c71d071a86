"""The size study: small runs, and scores of known errors."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.measurement import Measurement
from palpate_studies import size
from palpate_studies.size import SizedStrawberry


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
