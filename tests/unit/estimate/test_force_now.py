"""Force at every frame: from the dead-weight law, from calibrated laws, and from both."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.estimate.force_follower import (
    SPREAD_N,
    ForceFollower,
    half_width_percent,
    most_useful_n,
)
from palpate.estimate.force_law import ForceLaw
from palpate.estimate.force_now import ForceLaws, ForceNow
from palpate.estimate.force_states import ForceStates, compute_states
from palpate.estimate.pixel_law import PixelForceLaw, PixelReading

WEIGHTS_N = np.array(SPREAD_N)
#: Excess of a synthetic sheet at these weights.
EXCESS = 8.0 * WEIGHTS_N**1.2
MEMORY = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])


def dead_weight_law(count: int = 3) -> ForceLaw:
    return ForceLaw.fit(EXCESS[:count].tolist(), force_n=WEIGHTS_N[:count])


def make_force_now(*, creep: float = 1.0, memory: ForceLaw | None = None) -> ForceNow:
    """Return a follower of a sheet that reads `creep` times as much when settled."""
    early, settled = (
        PixelForceLaw(
            log_scale=-math.log(more),
            exponent=1.0,
            residual_sd=0.05,
            floor_n=0.01,
            range=(0.1, 50.0),
        )
        for more in (1.0, creep)
    )
    laws = ForceLaws(PixelReading.sum_pixels(), early=early, settled=settled, memory=memory)
    return ForceNow(laws, early_s=0.4, settled_s=20.0)


def test_force_follower_shows_force_only_with_contact() -> None:
    follower, rng = ForceFollower(dead_weight_law()), np.random.default_rng(2)
    for frame in range(50):
        answer = follower.step(0.02 * frame, 0.03 * rng.standard_normal((4, 2)))
        assert answer.value == answer.low == 0.0 < answer.high
    for frame in range(50, 1200):
        answer = follower.step(0.02 * frame, np.full((4, 2), 4.0**1.2))
    assert answer.low < 4.0 < answer.high
    assert answer.value == pytest.approx(4.0, rel=0.15)


def test_force_follower_of_sheet_that_hardly_responds_shows_its_weights() -> None:
    """No pixel of this sheet reaches the usual threshold of a contact."""
    excess, weights_n = [0.04, 0.12, 0.3], [1.5, 9.0, 24.0]
    for one, weight_n in zip(excess, weights_n, strict=True):
        follower = ForceFollower(ForceLaw.fit(excess, force_n=weights_n))
        for frame in range(1500):
            answer = follower.step(0.02 * frame, [[0.003, 0.0]] if frame < 10 else [[one, 0.0]])
            if frame < 10:
                assert answer.value == answer.low == 0.0 < answer.high < 3.0
        assert answer.low < weight_n < answer.high


def test_half_width_falls_with_each_weight() -> None:
    laws = (ForceLaw(), dead_weight_law(1), dead_weight_law())
    widest = [max(half_width_percent(law, at_n) for at_n in SPREAD_N) for law in laws]
    assert np.all(np.diff(widest) < 0)
    assert most_useful_n(laws[1]) == 9.0


def test_force_now_of_creeping_reading_is_constant() -> None:
    follower = make_force_now(creep=1.25)
    follower.step(0.0, [[0.0]])
    for time_s in np.arange(0.02, 30.0, 0.02):
        since = max(time_s - 1.0, 0.4)
        creep = 1.25 ** (math.log(min(since, 20.0) / 0.4) / math.log(50.0))
        said = follower.step(float(time_s), [[4.0 * creep if time_s > 1.0 else 0.0]])
        if time_s > 2.0:
            # The step is felt for a few copies of the reading after it came to rest.
            assert said.value == pytest.approx(4.0, rel=0.12)
            assert said.low < 4.0 < said.high
    assert said.value == pytest.approx(4.0, rel=0.01)


def test_force_now_interval_covers_both_laws_until_settled() -> None:
    follower = make_force_now(creep=1.25)
    said = [follower.step(0.02 * frame, [[5.0]]) for frame in range(2000)]
    assert said[250].high - said[250].low > 1.5 * (said[-1].high - said[-1].low)


def test_force_now_with_memory_is_between_both_laws() -> None:
    followers = make_force_now(memory=MEMORY), make_force_now(), ForceFollower(MEMORY)
    found = followers[0].step(0.0, [[0.0]])
    assert (found.value, found.low) == (0.0, 0.0)
    for time_s, excess in ((0.0, 0.0), (1.0, 15.0), (2.0, 15.0)):
        found, one, another = (follower.step(time_s, [[excess]]) for follower in followers)
    assert found.value == pytest.approx(math.sqrt(one.value * another.value))
    assert another.value < found.value < one.value
    assert found.high / found.low > one.value / another.value


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-3.0, 8.0), min_size=3, max_size=30), st.integers(1, 20))
def test_force_states_are_causal(readings: list[float], cut: int) -> None:
    time_s = 0.01 * np.arange(len(readings))
    whole = compute_states(time_s, readings)
    np.testing.assert_array_equal(compute_states(time_s[:cut], readings[:cut]), whole[:cut])
    assert np.isfinite(whole).all()


def test_force_states_time_that_runs_backwards_is_refused() -> None:
    memory = ForceStates()
    memory.step(1.0, 0.0)
    with pytest.raises(ValueError, match="time runs backwards"):
        memory.step(0.5, 0.0)
