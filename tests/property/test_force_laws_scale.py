"""Properties of force estimates: invariance to scaling, order and batches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.estimate.force import PowerForceLaw


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.01, 100.0))
def test_static_law_scales_with_force_and_ignores_order(seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    force = np.geomspace(0.5, 10, 10)
    excess = force**1.3 * np.exp(0.1 * rng.standard_normal(10))
    shuffled = rng.permutation(10)
    one = PowerForceLaw.fit(excess, force_n=force).force_n(excess).value
    other = PowerForceLaw.fit(excess[shuffled], force_n=factor * force[shuffled])
    assert other.force_n(excess).value == pytest.approx(factor * one, rel=0.02)
