"""The staircase study: laws and learners track forces on other sheets."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_studies import staircases
from palpate_studies.protocol.parts import SeenBeforeError
from palpate_studies.staircases import (
    LEAST_SCORED_N,
    FollowedForce,
    follow_staircases,
    learn_from_staircases,
)


@pytest.mark.slow
def test_follow_staircases_tracks_force_with_laws_and_trees_of_other_sheets() -> None:
    trees = learn_from_staircases([4, 5], level="lab", staircases=1)
    with pytest.raises(SeenBeforeError, match="4 was used"):
        follow_staircases(4, level="lab", staircases=1, trees=trees)
    found = follow_staircases(3, level="lab", staircases=1, trees=trees)
    assert list(found) == list(staircases.METHODS)
    (now,), (learned,) = found["now"], found["trees"]
    assert (now.force_n > LEAST_SCORED_N).all()
    assert np.median(np.abs(np.log(np.maximum(now.value_n, 0.01) / now.force_n))) < 0.3
    assert (now.low_n <= now.value_n).all()
    assert (now.value_n <= now.high_n).all()
    np.testing.assert_array_equal(learned.force_n, now.force_n)
    assert np.median(np.abs(learned.value_n - learned.force_n)) < 1.0
    scores = staircases._scores([learned], [now])
    assert (scores["coverage"], scores["mean_half_width_n"]) == (None, None)
    runs = dict.fromkeys(staircases.LEVELS, found)
    assert [row["rival"] for row in staircases._compare_baselines(runs)] == 2 * [
        *staircases.BASELINES
    ]


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
