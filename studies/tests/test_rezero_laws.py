"""A held object is never zeroed away, whatever came before."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_studies.rezero import RezeroRule, RezeroState, rezero_step

RULE = RezeroRule()
OPEN_MM, FRAME_S = 74.0, 0.2
#: One grasp: size of the object, closing beyond it (mm), change under load (%), how long it is held
#: and the hand open afterwards (s), how far it opens (mm beyond the object), drift (% per s).
GRASPS = st.lists(
    st.tuples(
        st.floats(15.0, 60.0),
        st.floats(0.2, 5.0),
        st.floats(-95.0, -11.0),
        st.floats(0.5, 40.0),
        st.floats(0.0, 15.0),
        st.floats(0.0, 14.0),
        st.floats(-0.05, 0.05),
    ),
    min_size=1,
    max_size=5,
)


@settings(max_examples=60, deadline=None)
@given(grasps=GRASPS, noise=st.floats(0.0, 0.4), seed=st.integers(0, 99))
def test_a_held_object_stays_held(grasps: list[tuple[float, ...]], noise: float, seed: int) -> None:
    rng, now_s, true_rest = np.random.default_rng(seed), 0.0, np.full((2, 2), 5000.0)
    state = RezeroState.calibrated(true_rest)

    def frame(change_percent: float, width_mm: float, *, moving: bool, drift: float) -> None:
        nonlocal state, now_s, true_rest
        now_s += FRAME_S
        true_rest = true_rest * (1 + drift * FRAME_S / 100)
        scatter = 1 + noise / 100 * rng.standard_normal((2, 2))
        ohm = true_rest * (1 + change_percent / 100) * scatter
        state = rezero_step(state, ohm, time_s=now_s, width_mm=width_mm, moving=moving, rule=RULE)

    for size_mm, closing_mm, load_percent, held_s, open_s, beyond_mm, drift in grasps:
        frame(0.0, OPEN_MM, moving=True, drift=drift)
        frame(0.0, size_mm, moving=True, drift=drift)
        held = state.rest_ohm
        for _ in range(int(held_s / FRAME_S)):
            frame(load_percent, size_mm - closing_mm, moving=False, drift=drift)
            assert state.rest_ohm is held
        frame(0.0, size_mm + beyond_mm, moving=True, drift=drift)
        for _ in range(int(open_s / FRAME_S)):
            frame(0.0, size_mm + beyond_mm, moving=False, drift=drift)
    assert np.all(np.abs(state.rest_ohm / state.calibrated_ohm - 1) <= RULE.total_percent / 100)


@settings(max_examples=60, deadline=None)
@given(
    frames=st.lists(
        st.tuples(
            st.floats(100.0, 20000.0),
            st.one_of(st.none(), st.floats(0.0, 74.0)),
            st.booleans(),
            st.floats(0.01, 3.0),
        ),
        min_size=1,
        max_size=60,
    )
)
def test_rest_values_move_little_and_only_in_an_open_still_hand(
    frames: list[tuple[float, float | None, bool, float]],
) -> None:
    state, now_s = RezeroState.calibrated(np.full((1, 2), 5000.0)), 0.0
    for ohm, width_mm, moving, step_s in frames:
        now_s += step_s
        before = state
        state = rezero_step(
            state, np.full((1, 2), ohm), time_s=now_s, width_mm=width_mm, moving=moving, rule=RULE
        )
        if state.rest_ohm is before.rest_ohm:
            continue
        change = 100 * (state.rest_ohm / before.rest_ohm - 1)
        assert np.all(change >= -RULE.fall_percent)
        assert np.all(change <= RULE.rise_percent)
        assert not moving
        assert width_mm is not None
        assert before.contact_mm is not None
        assert width_mm >= before.contact_mm + RULE.clear_mm
