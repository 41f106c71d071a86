"""Properties of the relaxation predictor: equivariance, finite values, preserved sign."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from palpate.settling.relaxation import Relaxation

METHOD = Relaxation()


@st.composite
def settling_holds(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Draw noisy holds with uneven sampling."""
    seed = draw(st.integers(0, 2**31))
    rng = np.random.default_rng(seed)
    n_times = draw(st.integers(2, 60))
    time_s = np.cumsum(rng.uniform(0.005, 0.4, n_times))
    curve = -rng.uniform(0.5, 5) * np.log(time_s + rng.uniform(0.1, 2))
    noise = rng.normal(0, draw(st.sampled_from([1e-3, 0.05, 0.5])), n_times)
    return time_s, 50 + curve + noise


@settings(max_examples=60, deadline=None)
@given(settling_holds(), st.floats(1e-3, 1e3))
def test_relaxation_of_positive_values_is_equivariant_to_scale(
    hold: tuple[np.ndarray, np.ndarray], scale: float
) -> None:
    time_s, values = hold
    plain, scaled = (
        METHOD.predict(time_s, factor * values[None], horizon_s=40.0, level=0.9).hold(0)
        for factor in (1.0, scale)
    )
    for end in ("value", "low", "high"):
        assert np.isclose(getattr(scaled, end), scale * getattr(plain, end), rtol=1e-5)
    assert scaled.status is plain.status


@settings(max_examples=60, deadline=None)
@given(
    settling_holds(), st.floats(1e-3, 1e3), st.sampled_from([-1.0, 1.0]), st.floats(-1e3, -100.0)
)
def test_relaxation_of_signed_values_is_equivariant_to_scale_sign_and_offset(
    hold: tuple[np.ndarray, np.ndarray], scale: float, sign: float, shift: float
) -> None:
    time_s, values = hold
    values = values - values.mean()
    plain = METHOD.predict(time_s, values[None], horizon_s=40.0, level=0.9).hold(0)
    moved = METHOD.predict(
        time_s, scale * (sign * values[None] + shift), horizon_s=40.0, level=0.9
    ).hold(0)
    ends = sorted([sign * plain.low + shift, sign * plain.high + shift])
    # Tolerance for rounding, because the shift can be a million times the drop.
    tolerance = 1e-5 * (plain.high - plain.low) + 1e-9 * abs(shift)
    assert abs(moved.value / scale - (sign * plain.value + shift)) <= tolerance
    assert abs(moved.low / scale - ends[0]) <= 10 * tolerance
    assert abs(moved.high / scale - ends[1]) <= 10 * tolerance
    assert moved.status is plain.status


@settings(max_examples=80, deadline=None)
@given(
    st.integers(1, 40).flatmap(
        lambda n: st.tuples(
            arrays(np.float64, (3, n), elements=st.floats(1e-3, 1e6, width=64)),
            arrays(np.float64, n, elements=st.floats(1e-4, 1.0)),
        )
    )
)
def test_relaxation_of_positive_values_predicts_positive_values(
    drawn: tuple[np.ndarray, np.ndarray],
) -> None:
    values, steps = drawn
    estimate = METHOD.predict(np.cumsum(steps), values, horizon_s=60.0, level=0.95)
    assert (np.concatenate([estimate.value, estimate.low, estimate.high]) > 0).all()


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(
    st.integers(1, 40).flatmap(
        lambda n: st.tuples(
            arrays(np.float64, (3, n), elements=st.floats(-1e6, 1e6, width=32)),
            arrays(np.float64, n, elements=st.floats(1e-4, 1.0)),
        )
    ),
    st.floats(0.01, 0.99),
)
@example(drawn=(np.array([[1.6e-35, 69.0], [69.0, 1.6e-35]]), np.array([0.01, 0.01])), level=0.5)
def test_relaxation_is_finite_and_inside_its_interval(
    drawn: tuple[np.ndarray, np.ndarray], level: float
) -> None:
    values, steps = drawn
    estimate = METHOD.predict(np.cumsum(steps), values, horizon_s=20.0, level=level)
    assert np.isfinite(np.concatenate([estimate.value, estimate.low, estimate.high])).all()
    assert (estimate.low <= estimate.value).all()
    assert (estimate.value <= estimate.high).all()
