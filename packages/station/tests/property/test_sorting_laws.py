"""Invariants of identification, sorting and bruises for any input."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from palpate.arrays import FloatArray
from palpate.measurement import Measurement
from palpate_station.bruise.shape import contrast, fit_load_shape, pixel_contrast
from palpate_station.identify.identifier import Identifier, Identity, combine
from palpate_station.learning import FALSE_REJECT, UNKNOWN
from palpate_station.sorting.conditions import Evidence, OneOf, Within
from palpate_station.sorting.rules import Rule, RuleBook, decide

LN = st.floats(-3.0, 6.0)


def features(value: tuple[float, float], *, shift: float = 0.0) -> FloatArray:
    return np.array(value) + shift


def train_identifier(shift: float = 0.0) -> Identifier:
    rng = np.random.default_rng(6)
    centres = {"kiwi": (3.9, 0.4), "lime": (3.8, 1.3), "apple": (4.1, 1.7)}
    return Identifier(
        [
            (kind, [np.array(at) + 0.1 * rng.standard_normal(2) + shift])
            for kind, at in centres.items()
            for _ in range(8)
        ]
    )


IDENTIFIER, SHIFTED = train_identifier(), train_identifier(shift=1.5)
grasps = st.lists(st.tuples(LN, LN), min_size=1, max_size=4)


@settings(max_examples=60)
@given(grasps)
def test_identify_probabilities_are_valid_and_sum_to_one(points: list[tuple[float, float]]) -> None:
    found = IDENTIFIER.identify([features(one) for one in points])
    assert sum(found.probability.values()) == pytest.approx(1.0)
    assert all(0.0 <= p <= 1.0 for p in found.probability.values())
    assert 0.0 < found.usual <= 1.0
    assert found.rejected == (found.usual <= FALSE_REJECT)
    assert found.rejected == (found.kind == UNKNOWN)


@settings(max_examples=60)
@given(grasps)
def test_identify_is_independent_of_grasp_order(points: list[tuple[float, float]]) -> None:
    features_of_grasps = [features(one) for one in points]
    reverse = IDENTIFIER.identify(features_of_grasps[::-1])
    found = IDENTIFIER.identify(features_of_grasps)
    assert dict(reverse.probability) == pytest.approx(dict(found.probability), abs=1e-6)


@settings(max_examples=60)
@given(grasps)
def test_identify_is_independent_of_units(points: list[tuple[float, float]]) -> None:
    """A change of units in training and test data does not change the result."""
    found = IDENTIFIER.identify([features(one) for one in points])
    moved = SHIFTED.identify([features(one, shift=1.5) for one in points])
    assert dict(moved.probability) == pytest.approx(dict(found.probability), abs=1e-6)
    assert moved.usual == pytest.approx(found.usual)


fractions = st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)).filter(
    lambda t: sum(t) > 0
)
names = st.frozensets(st.sampled_from(["kiwi", "lime", UNKNOWN]), min_size=1)
spans = st.tuples(st.floats(0, 80), st.floats(1, 60)).map(
    lambda pair: Within("size_mm", pair[0], pair[0] + pair[1])
)
rules = st.builds(
    Rule,
    bin=st.sampled_from(["a", "b", "c"]),
    conditions=st.tuples(
        st.none() | names.map(lambda found: OneOf("class", found)),
        st.none() | spans,
        st.none() | st.just(OneOf("ripeness", frozenset({"ripe"}))),
        st.none()
        | st.sampled_from(
            [OneOf("bruised", frozenset({"true"})), OneOf("bruised", frozenset({"false"}))]
        ),
    ).map(lambda some: tuple(filter(None, some))),
    confidence=st.floats(0.5, 0.99),
)
sizes = st.tuples(st.floats(5, 75), st.floats(0.01, 10), st.floats(0.01, 10)).map(
    lambda t: Measurement(value=t[0], low=t[0] - t[1], high=t[0] + t[2], unit="mm")
)


@st.composite
def evidence(draw: st.DrawFn) -> Evidence:
    parts = np.array(draw(fractions))
    probability = dict(zip(("kiwi", "lime", UNKNOWN), (parts / parts.sum()).tolist(), strict=True))
    rejected = draw(st.booleans())
    identity = Identity(
        kind=UNKNOWN if rejected else "kiwi",
        probability=probability,
        usual=0.01 if rejected else 0.5,
        rejected=rejected,
        grasps=1,
    )
    return Evidence(
        identity=draw(st.none() | st.just(identity)),
        size_mm=draw(st.none() | sizes),
        ripeness=draw(st.sampled_from([{}, {"ripe": 0.7, "hard": 0.3}])),
        bruised=draw(st.none() | st.floats(0, 1)),
        grasps=draw(st.integers(0, 4)),
    )


@pytest.mark.slow
@given(st.lists(rules, min_size=1, max_size=4), evidence(), st.integers(1, 4))
@settings(max_examples=200)
def test_decide_returns_known_bin_within_grasp_limit(
    book: list[Rule], seen: Evidence, most: int
) -> None:
    found = decide(RuleBook(rules=tuple(book), default_bin="rest", most_grasps=most), seen)
    assert found.bin in {"a", "b", "c", "rest"}
    assert found.why.startswith(found.bin)
    if found.needs_regrasp:
        assert seen.grasps < most
    if found.rule is None:
        assert found.bin == "rest"
    else:
        low, high = found.rule.probability(seen)
        assert found.rule.confidence <= low <= high <= 1.0 + 1e-9
        assert found.probability == low


@given(st.lists(sizes, min_size=2, max_size=4))
def test_combined_size_is_narrow_only_if_the_grasps_agree(grasped: list[Measurement]) -> None:
    both = combine(grasped)
    below, above = (max(grasped, key=lambda one: sign * one.middle) for sign in (-1, 1))
    widths = below.high - below.low + above.high - above.low
    if above.middle - below.middle > 2.0 * widths:
        assert all(both.low <= one.low <= one.high <= both.high for one in grasped)
    assert both.low < both.value < both.high


@given(sizes, st.floats(5, 75))
def test_complementary_size_ranges_have_total_probability_one(
    size: Measurement, cut: float
) -> None:
    below, above = Within("size_mm", -1e9, cut), Within("size_mm", cut, 1e9)
    seen = Evidence(size_mm=size)
    probabilities = [condition.probability(seen) for condition in (below, above)]
    assert sum(one or 0.0 for one in probabilities) == pytest.approx(1.0)


CHANGES = arrays(np.float64, (4, 2), elements=st.floats(-99.0, 5.0))
#: Name and operation on the pixels.
MOVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "fingers exchanged": lambda change: change[[2, 3, 0, 1]],
    "mirrored along": lambda change: change[[1, 0, 3, 2]],
    "mirrored across": lambda change: change[:, ::-1],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MOVES)
@given(now=CHANGES, before=CHANGES)
def test_bruise_contrast_is_invariant_to_swapped_or_turned_pixels(
    name: str, now: np.ndarray, before: np.ndarray
) -> None:
    move = MOVES[name]
    plain = fit_load_shape(now, width_mm=66.0), fit_load_shape(before, width_mm=65.0)
    moved = fit_load_shape(move(now), width_mm=66.0), fit_load_shape(move(before), width_mm=65.0)
    assert contrast(*moved) == pytest.approx(contrast(*plain), abs=1e-3)


@given(change=CHANGES)
def test_bruise_contrast_of_a_shape_with_itself_is_zero(change: np.ndarray) -> None:
    shape = fit_load_shape(change, width_mm=66.0)
    assert not contrast(shape, shape).any()
    assert not pixel_contrast(shape, shape, rows=4, cols=2).any()


@given(now=CHANGES, before=CHANGES)
def test_bruise_pixel_contrast_of_facing_pixels_is_opposite(
    now: np.ndarray, before: np.ndarray
) -> None:
    found = pixel_contrast(fit_load_shape(now), fit_load_shape(before), rows=4, cols=2)
    assert found[:2] == pytest.approx(-found[2:])
