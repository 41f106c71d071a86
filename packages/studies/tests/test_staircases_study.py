"""The staircase study: laws and learners track forces on other sheets."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_studies import staircases
from palpate_studies.staircases import (
    FollowedForce,
)


def test_staircase_scores_of_known_errors_are_exact() -> None:
    force = np.array([1.0, 2.0, 4.0])
    low = {"sensor": 0, "force_n": force, "low_n": 0 * force}
    half = FollowedForce(**low, value_n=force / 2, high_n=force * 0.9)
    exact = FollowedForce(**low, value_n=force, high_n=force * 2)
    scores = staircases._scores([half], [half])
    assert scores["share_of_settled"] == 1
    assert scores["rms_log_error"] == pytest.approx(np.log(2))
    assert scores["rms_log_error_own_gain_out"] == pytest.approx(0)
    assert scores["coverage"] == 0
    assert staircases._scores([exact], [half])["share_of_settled"] == 0
