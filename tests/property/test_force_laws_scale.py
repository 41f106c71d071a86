"""Laws of the force estimates: what scaling, order and batches must not change."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.estimate.force import PowerForceLaw
from palpate.estimate.observer import ForceObserver, ObserverModel

MODEL = ObserverModel(
    time_constants_s=(0.1, 1.0),
    weights=(0.8, -0.1, 0.1),
    sharing=0.5,
    unloading=0.3,
    spread=(0.02, 0.01, 0.1, 0.1),
    tail=1.2,
)
READINGS = st.lists(st.floats(0.0, 500.0), min_size=3, max_size=30)


def said(readings: list[float], told_n: float) -> np.ndarray:
    """Return value, low and high of every reading after the second, at which the force is told."""
    observer = ForceObserver(MODEL)
    answers = []
    for k, excess in enumerate(readings):
        now = observer.step(0.05 * k, [excess])
        if k == 1:
            observer.tell([told_n])
        elif k > 1:
            answers.append([now.value_n[0], now.low_n[0], now.high_n[0]])
    return np.array(answers)


@settings(max_examples=60, deadline=None)
@given(READINGS, st.floats(0.1, 50.0), st.floats(0.1, 10.0))
def test_the_observer_scales_with_the_force_told(
    readings: list[float], told_n: float, factor: float
) -> None:
    assert said(readings, told_n * factor) == pytest.approx(factor * said(readings, told_n))


@settings(max_examples=60, deadline=None)
@given(READINGS)
def test_intervals_hold_their_value_and_stay_finite(readings: list[float]) -> None:
    value, low, high = said(readings, 2.0).T
    assert np.isfinite([value, low, high]).all()
    assert ((low < value) & (value < high)).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.01, 100.0))
def test_a_static_law_scales_with_force_and_ignores_order(seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    force = np.geomspace(0.5, 10, 10)
    excess = force**1.3 * np.exp(0.1 * rng.standard_normal(10))
    shuffled = rng.permutation(10)
    one = PowerForceLaw.fit(excess, force_n=force).force_n(excess).value
    other = PowerForceLaw.fit(excess[shuffled], force_n=factor * force[shuffled])
    assert other.force_n(excess).value == pytest.approx(factor * one, rel=0.02)
