"""Properties of the published methods: independence of unit, sign and offset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.settling.baselines import LogLaw, Recorded
from palpate.settling.exponential import Exponential

METHODS = [Recorded(), Exponential(), LogLaw()]


@st.composite
def holds(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Draw unevenly sampled holds: decay, creep, random walk or constant."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_times = draw(st.integers(2, 60))
    time_s = np.cumsum(rng.uniform(0.02, 0.2, n_times))
    kind = draw(st.sampled_from(["decay", "creep", "walk", "constant"]))
    since = time_s - time_s[0]
    values = {
        "decay": 10 * np.exp(-rng.uniform(0.3, 4) * since),
        "creep": -np.log(since + 0.3),
        "walk": np.cumsum(rng.normal(size=n_times)),
        "constant": np.zeros(n_times),
    }[kind]
    noise = 0.0 if kind == "constant" else 0.02
    return time_s, values + rng.normal(0, 1, (3, n_times)) * noise


def predict(method, time_s: np.ndarray, values: np.ndarray):
    return method.predict(time_s, values, horizon_s=time_s[-1] + 10, level=0.9)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@settings(max_examples=40, deadline=None)
@given(hold=holds(), power=st.integers(-20, 20))
def test_published_methods_are_exactly_equivariant_to_scale_and_sign(
    method, hold, power: int
) -> None:
    """A power of two and a sign cause no rounding, so results are identical."""
    time_s, values = hold
    plain = predict(method, time_s, values)
    for factor in (-1.0, 2.0**power):
        scaled = predict(method, time_s, factor * values)
        assert (scaled.value == factor * plain.value).all()
        assert scaled.status.tolist() == plain.status.tolist()


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@settings(max_examples=40, deadline=None)
@given(hold=holds(), shift=st.sampled_from([-100.0, -1.0, 64.0, 4096.0]))
def test_published_methods_are_equivariant_to_an_offset(method, hold, shift: float) -> None:
    """The values are equal up to rounding, and the statuses are equal."""
    time_s, values = hold
    # On this grid the sum of value and shift is exact.
    values = np.round(values * 2**20) / 2**20
    plain, shifted = predict(method, time_s, values), predict(method, time_s, values + shift)
    assert shifted.status.tolist() == plain.status.tolist()
    assert shifted.value - shift == pytest.approx(plain.value, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@settings(max_examples=40, deadline=None)
@given(hold=holds())
def test_published_methods_predict_finite_values(method, hold) -> None:
    time_s, values = hold
    assert np.isfinite(predict(method, time_s, values).value).all()
