"""Properties of the force laws: order of readings, causality, scale and updates."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from palpate.force.force_law import ForceLaw


def is_reversed(known: list[tuple[float, float]]) -> bool:
    """Return whether the readings fall on the whole while the force rises, as of a resistance."""
    log_x, log_n = np.log(known).T
    return len(known) > 2 and float((log_n - log_n.mean()) @ (log_x - log_x.mean())) <= 0


EXCESS = st.floats(0.5, 200.0)
FORCE = st.floats(0.2, 40.0)


@given(st.lists(st.tuples(EXCESS, FORCE), min_size=1, max_size=8), EXCESS)
def test_force_law_interval_contains_value_and_is_finite(
    known: list[tuple[float, float]], excess: float
) -> None:
    assume(not is_reversed(known))
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


@given(
    st.lists(st.tuples(EXCESS, FORCE), min_size=1, max_size=6),
    st.floats(1e-3, 1e3),
    st.floats(0.0, 3.0),
)
def test_force_law_is_the_same_in_any_unit_of_the_reading(
    known: list[tuple[float, float]], unit: float, at: float
) -> None:
    assume(not is_reversed(known))
    force_n = [f for _, f in known]
    one = ForceLaw.fit([x for x, _ in known], force_n=force_n)
    other = ForceLaw.fit([unit * x for x, _ in known], force_n=force_n)
    excess = at * min(x for x, _ in known)
    for found, expected in zip(
        (other.force(unit * excess), other.force(unit * known[0][0])),
        (one.force(excess), one.force(known[0][0])),
        strict=True,
    ):
        numbers = [found.value, found.low, found.high]
        np.testing.assert_allclose(
            numbers, [expected.value, expected.low, expected.high], rtol=1e-6, atol=1e-9
        )


@given(st.lists(st.tuples(st.floats(1e-4, 1e4), FORCE), min_size=1, max_size=6))
def test_force_law_interval_includes_every_given_force(known: list[tuple[float, float]]) -> None:
    assume(not is_reversed(known))
    law = ForceLaw.fit([x for x, _ in known], force_n=[f for _, f in known])
    for excess, force_n in known:
        answer = law.force(excess)
        assert answer.low <= force_n <= answer.high
