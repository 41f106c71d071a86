"""The force model: what scales, what leaks, what a measured force moves, what intervals hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.errors import CalibrationError
from palpate.estimate.force_states import ForceStates, states_of
from palpate_studies.force_model import ForceModel

SENSORS = 12


def samples(seed: int = 1) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Return readings of sensors whose gains scatter by 0.3, ln force and the sensor of each."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(SENSORS), 40)
    x = rng.uniform(0, 4, len(group))
    gain = rng.normal(0, 0.3, SENSORS)[group]
    return x[:, None], 0.8 * x + gain + rng.normal(0, 0.05, len(x)), group.tolist()


def test_intervals_hold_on_sensors_that_were_not_learned() -> None:
    x, y, group = samples()
    value, half = ForceModel.fit(x, target=y, group=group).predict(samples(seed=2)[0])
    covered = np.abs(value - samples(seed=2)[1]) <= half
    assert 0.8 < covered.mean() < 0.98


@settings(max_examples=10, deadline=None)
@given(st.floats(-3.0, 3.0))
def test_forces_in_another_unit_shift_the_answer_alone(shift: float) -> None:
    x, y, group = samples()
    one, other = (ForceModel.fit(x, target=y + by, group=group).predict(x) for by in (0.0, shift))
    np.testing.assert_allclose(other[0] - shift, one[0], atol=0.02)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-3.0, 8.0), min_size=3, max_size=30), st.integers(1, 20))
def test_states_know_no_later_reading(readings: list[float], cut: int) -> None:
    time_s = 0.01 * np.arange(len(readings))
    whole = states_of(time_s, readings)
    np.testing.assert_array_equal(states_of(time_s[:cut], readings[:cut]), whole[:cut])
    assert np.isfinite(whole).all()


def test_a_gain_of_the_sheet_shifts_the_first_state_only() -> None:
    readings = np.sin(np.arange(50) / 5)
    one, other = (
        states_of(np.arange(50) / 20, readings),
        states_of(np.arange(50) / 20, readings + 1),
    )
    np.testing.assert_allclose(other - one, np.eye(8)[0] * np.ones((50, 1)), atol=1e-9)


def test_what_can_not_be_used_is_refused() -> None:
    with pytest.raises(CalibrationError, match="3 samples"):
        ForceModel.fit([[1.0]] * 3, target=[1.0] * 3, group=[0] * 3)
    with pytest.raises(CalibrationError, match="not a finite number"):
        ForceModel.fit([[np.nan]] * 6, target=[1.0] * 6, group=[0] * 6)
    memory = ForceStates()
    memory.step(1.0, 0.0)
    with pytest.raises(ValueError, match="time runs backwards"):
        memory.step(0.5, 0.0)
