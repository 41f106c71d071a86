"""The staircase study: laws and learners track forces on other sheets."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.rig.simulated import calibrate_twin
from palpate_studies import staircases
from palpate_studies.protocol.parts import SeenBeforeError
from palpate_studies.staircases import (
    LEAST_SCORED_N,
    FollowedForce,
    follow_staircases,
    learn_from_staircases,
    list_features,
)


@pytest.mark.slow
def test_follow_staircases_with_calibrated_laws_tracks_force() -> None:
    found = follow_staircases(3, level="lab", staircases=1)
    assert list(found) == ["settled", "by_time", "memory", "now"]
    (now,) = found["now"]
    assert (now.force_n > LEAST_SCORED_N).all()
    assert np.median(np.abs(np.log(np.maximum(now.value_n, 0.01) / now.force_n))) < 0.3
    assert (now.low_n <= now.value_n).all()
    assert (now.value_n <= now.high_n).all()


@pytest.mark.slow
def test_follow_staircases_with_trees_rejects_training_sheets() -> None:
    trees = learn_from_staircases([4, 5], level="lab", staircases=1)
    with pytest.raises(SeenBeforeError, match="4 was used"):
        follow_staircases(4, level="lab", staircases=1, trees=trees)
    found = follow_staircases(3, level="lab", staircases=1, trees=trees)
    assert list(found) == list(staircases.METHODS)
    (now,), (learned,) = found["now"], found["trees"]
    np.testing.assert_array_equal(learned.force_n, now.force_n)
    assert np.median(np.abs(learned.value_n - learned.force_n)) < 1.0
    scores = staircases._scores([learned], [now])
    assert (scores["coverage"], scores["mean_half_width_n"]) == (None, None)
    runs = dict.fromkeys(staircases.LEVELS, found)
    assert [row["rival"] for row in staircases._compare_baselines(runs)] == 2 * [
        *staircases.BASELINES
    ]


@pytest.mark.slow
def test_list_features_does_not_depend_on_later_frames() -> None:
    pairs = calibrate_twin(seed=3, level="lab", apart_from="").force
    time_s = np.arange(40) / 15
    excess = np.full((40, 4, 2), 0.3)
    excess[20:] *= 2.0
    seen = list_features(time_s, excess, pairs=pairs)
    np.testing.assert_array_equal(seen[:20], list_features(time_s[:20], excess[:20], pairs=pairs))
    since_moved_s, since_start_s = seen[:, -2:].T
    np.testing.assert_allclose(since_start_s, time_s)
    assert since_moved_s[20] == 0.0
    assert since_moved_s[35] == pytest.approx(13 / 15)
    # Readings above the rest, as with an open hand, give finite features.
    assert np.isfinite(list_features(time_s, excess - 0.9, pairs=pairs)).all()


def test_staircase_scores_of_known_errors_are_exact() -> None:
    force = np.array([1.0, 2.0, 4.0])
    half = FollowedForce(
        sensor=0,
        force_n=force,
        value_n=force / 2,
        low_n=0 * force,
        high_n=force * 0.9,
    )
    exact = FollowedForce(sensor=0, force_n=force, value_n=force, low_n=0 * force, high_n=force * 2)
    scores = staircases._scores([half], [half])
    assert scores["share_of_settled"] == 1
    assert scores["rms_log_error"] == pytest.approx(np.log(2))
    assert scores["rms_log_error_own_gain_out"] == pytest.approx(0)
    assert scores["coverage"] == 0
    assert staircases._scores([exact], [half])["share_of_settled"] == 0
