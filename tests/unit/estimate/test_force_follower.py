"""Force at every frame from the dead-weight law, and the most useful next weight."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.calibrate.laws import force_now
from palpate.estimate.force_follower import (
    SPREAD_N,
    ForceFollower,
    half_width_percent,
    most_useful_n,
)
from palpate.estimate.force_law import ForceLaw
from palpate.sensor.calibration import ForcePairs

WEIGHTS_N = np.array(SPREAD_N)


def excess(force_n: np.ndarray) -> np.ndarray:
    """Return the excess of a synthetic sheet at settled forces."""
    return 8.0 * force_n**1.2


@pytest.fixture
def law() -> ForceLaw:
    return ForceLaw.fit(excess(WEIGHTS_N).tolist(), force_n=WEIGHTS_N)


def test_force_follower_shows_force_only_with_contact(law: ForceLaw) -> None:
    follower = ForceFollower(law)
    rng = np.random.default_rng(2)
    for frame in range(50):
        answer = follower.step(0.02 * frame, 0.03 * rng.standard_normal((4, 2)))
        assert (answer.value, answer.low) == (0.0, 0.0)
        assert answer.high > 0
    for frame in range(50, 1200):
        answer = follower.step(0.02 * frame, np.full((4, 2), excess(np.array(4.0)) / 8))
    assert answer.low < 4.0 < answer.high
    assert answer.value == pytest.approx(4.0, rel=0.15)


def test_force_follower_open_or_short_pixels_keep_force_finite(law: ForceLaw) -> None:
    follower = ForceFollower(law)
    for time_s, pixel in ((0.0, np.nan), (0.1, np.inf), (0.2, 1.0)):
        answer = follower.step(time_s, [[pixel, 3.0]])
        assert np.isfinite([answer.middle, answer.low, answer.high]).all()
        assert answer.has_value == (pixel != np.inf)


def test_half_width_falls_with_each_weight(law: ForceLaw) -> None:
    none = ForceLaw()
    one = ForceLaw.fit(excess(WEIGHTS_N[:1]).tolist(), force_n=WEIGHTS_N[:1])
    widths = [[half_width_percent(each, at_n) for at_n in SPREAD_N] for each in (none, one, law)]
    assert np.all(np.diff([max(each) for each in widths]) < 0)
    assert most_useful_n(one) == 9.0


def test_force_now_uses_stored_dead_weight_law() -> None:
    pairs = ForcePairs(
        run=(0, 0, 0),
        since_move_s=(20.0,) * 3,
        excess=tuple(excess(WEIGHTS_N).tolist()),
        relative_percent=(-50.0, -70.0, -85.0),
        force_n=tuple(WEIGHTS_N.tolist()),
    )
    follower = force_now(pairs)
    assert isinstance(follower, ForceFollower)


def test_force_follower_of_sheet_that_hardly_responds_shows_its_weights() -> None:
    """No pixel of this sheet reaches the usual threshold of a contact."""
    excess, weights_n = [0.04, 0.12, 0.3], [1.5, 9.0, 24.0]
    for one, weight_n in zip(excess, weights_n, strict=True):
        follower = ForceFollower(ForceLaw.fit(excess, force_n=weights_n))
        for frame in range(1500):
            answer = follower.step(0.02 * frame, [[0.003, 0.0]] if frame < 10 else [[one, 0.0]])
            if frame < 10:
                assert (answer.value, answer.low) == (0.0, 0.0)
                assert 0 < answer.high < 3.0
        assert answer.low < weight_n < answer.high
