"""Properties of the twin under any sequence of commands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.twin.objects import OBJECTS, draw_object
from palpate.twin.sheet_state import follow_line
from palpate.twin.world import World

MOVES = st.lists(
    st.tuples(st.floats(25.0, 74.0), st.floats(1.0, 60.0), st.floats(0.05, 3.0)),
    min_size=1,
    max_size=6,
)


@pytest.mark.slow
@settings(max_examples=25)
@given(
    moves=MOVES,
    name=st.sampled_from(sorted(OBJECTS)),
    level=st.sampled_from(["lab", "field"]),
    seed=st.integers(0, 1000),
)
def test_twin_any_commands_yield_physical_values(
    moves: list[tuple[float, float, float]], name: str, level: str, seed: int
) -> None:
    world = World(draw_object(np.random.default_rng(seed), name), seed=seed, level=level)
    top, highest_n = world.layout.divider.full_scale, 0.0
    for target_mm, rate, wait_s in moves:
        world.drive(target_mm, rate=rate, time_s=world.clock.now_s())
        world.clock.sleep_s(wait_s)
        now_s = world.clock.now_s()
        force_n = world.force_n(now_s)
        ohm = world.pixel_resistance_ohm(now_s)
        assert force_n >= 0.0
        assert np.all(np.isfinite(ohm))
        assert np.all(ohm > 0)
        counts = world.scan(now_s)
        assert np.all((counts >= 0) & (counts < top * world.oversampling))
        highest_n = max(highest_n, force_n)
    truth = world.truth()
    assert truth.peak_force_n >= highest_n
    assert -100.0 < truth.settled_percent < 100.0


@pytest.mark.slow
@settings(max_examples=20)
@given(moves=MOVES, seed=st.integers(0, 1000), interval_s=st.floats(0.003, 0.2))
def test_twin_readings_do_not_change_the_world(
    moves: list[tuple[float, float, float]], seed: int, interval_s: float
) -> None:
    read, unread = (
        World(draw_object(np.random.default_rng(seed), "tomato"), seed=seed) for _ in range(2)
    )
    now_s = 0.0
    for target_mm, rate, wait_s in moves:
        for world in (read, unread):
            world.drive(target_mm, rate=rate, time_s=now_s)
        for time_s in np.arange(now_s, now_s + wait_s, interval_s):
            read.pixel_resistance_ohm(float(time_s))
        now_s += wait_s
    np.testing.assert_allclose(
        read.pixel_resistance_ohm(now_s), unread.pixel_resistance_ohm(now_s), rtol=1e-9
    )


@given(
    rates=st.tuples(st.floats(1e-6, 40.0), st.floats(1e-6, 40.0)),
    targets=st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
    value=st.floats(-5.0, 5.0),
)
def test_follow_line_is_exact_for_divided_steps(
    rates: tuple[float, float], targets: tuple[float, float], value: float
) -> None:
    first, second = (np.array(rate) for rate in rates)
    start, end = (np.array(target) for target in targets)
    middle = start + (end - start) * first / (first + second)
    half = follow_line(np.array(value), start=start, end=middle, rate=first)
    cut = follow_line(half, start=middle, end=end, rate=second)
    whole = follow_line(np.array(value), start=start, end=end, rate=first + second)
    np.testing.assert_allclose(cut, whole, rtol=1e-9, atol=1e-9)


def test_follow_line_of_ramp_matches_hand_calculation() -> None:
    # tau z' = t/tau - z from 0: z = t/tau - 1 + exp(-t/tau), at t = tau 1/e.
    lag = follow_line(np.zeros(1), start=np.zeros(1), end=np.ones(1), rate=np.ones(1))
    np.testing.assert_allclose(lag, np.exp(-1.0))
