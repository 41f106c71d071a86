"""Properties of the force law: order of readings, causality, updates."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from palpate.estimate.force_law import ForceLaw

EXCESS = st.floats(0.5, 200.0)
FORCE = st.floats(0.2, 40.0)


@given(st.lists(st.tuples(EXCESS, FORCE), min_size=1, max_size=8), EXCESS)
def test_force_law_interval_contains_value_and_is_finite(
    known: list[tuple[float, float]], excess: float
) -> None:
    assume(len(known) < 3 or not is_reversed(known))
    law = ForceLaw.fit([x for x, _ in known], force_n=[f for _, f in known])
    answer = law.force(excess)
    assert 0 <= answer.low <= answer.value <= answer.high < np.inf


@given(EXCESS, FORCE)
def test_force_law_measured_force_narrows_interval_there(excess: float, force_n: float) -> None:
    law = ForceLaw()
    before = law.force(excess)
    after = law.update(excess, force_n=force_n).force(excess)
    assume(min(before.value, after.value) >= law.population.least_n)
    assert after.high / after.low < before.high / before.low


@given(EXCESS, EXCESS, FORCE)
def test_force_law_copy_is_independent(at: float, excess: float, force_n: float) -> None:
    law = ForceLaw()
    before = law.force(excess)
    law.copy().update(at, force_n=force_n)
    assert law.force(excess) == before
