"""States of the force law from the history of a reading."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.estimate.force_states import ForceStates, compute_states


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-3.0, 8.0), min_size=3, max_size=30), st.integers(1, 20))
def test_force_states_are_causal(readings: list[float], cut: int) -> None:
    time_s = 0.01 * np.arange(len(readings))
    whole = compute_states(time_s, readings)
    np.testing.assert_array_equal(compute_states(time_s[:cut], readings[:cut]), whole[:cut])
    assert np.isfinite(whole).all()


def test_states_time_that_runs_backwards_is_refused() -> None:
    memory = ForceStates()
    memory.step(1.0, 0.0)
    with pytest.raises(ValueError, match="time runs backwards"):
        memory.step(0.5, 0.0)
