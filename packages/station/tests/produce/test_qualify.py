"""Agreement with a reference: estimated figures compared with simulated ones."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_station.qualify import agreement
from palpate_station.qualify.agreement import (
    Demand,
    calculate_agreement,
    count_grades,
    estimate_effort,
    measure_agreement,
)
from palpate_station.qualify.readings import PairedReadings
from palpate_station.qualify.scatter import deming_lines, estimate_scatter

BETWEEN, REFERENCE_SD, GRASP_SD, SLOPE = 2.0, 1.0, 0.4, 0.5
CEILING = BETWEEN**2 / (BETWEEN**2 + REFERENCE_SD**2)


@pytest.fixture(autouse=True, scope="module")
def few_draws() -> Iterator[None]:
    """Draw less often than the command, whose intervals take seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(agreement, "_DRAWS", 200)
        yield


def make_readings(items: int, *, seed: int, sides: int = 2) -> PairedReadings:
    random = np.random.default_rng(seed)
    item = np.repeat(np.arange(items), sides)
    firmness = random.normal(10.0, BETWEEN, items)[item]
    return PairedReadings(
        item=item,
        reference=firmness + random.normal(0.0, REFERENCE_SD, item.size),
        grasp=SLOPE * (firmness + random.normal(0.0, GRASP_SD, item.size)) - 1.0,
    )


def test_calculate_agreement_many_items_recovers_simulated_figures() -> None:
    measured = calculate_agreement(
        make_readings(20_000, seed=1), Demand(tolerance=1.0, limits=(10.0,))
    )
    assert measured.slope == pytest.approx(1.0 / SLOPE, rel=0.02)
    assert measured.offset == pytest.approx(2.0, abs=0.1)
    assert measured.reference.within == pytest.approx(REFERENCE_SD, rel=0.02)
    assert measured.grasp.within == pytest.approx(GRASP_SD, rel=0.03)
    within = math.erf(1.0 / math.hypot(REFERENCE_SD, GRASP_SD) / math.sqrt(2.0))
    expected = {
        "r_squared_ceiling": CEILING,
        "share_within_ceiling": 0.683,
        "share_within": within,
        "share_within_reference": math.erf(0.5),
    }
    found = {name: measured.figures[name].value for name in expected}
    assert found == pytest.approx(expected, abs=0.01)


@pytest.mark.slow
def test_agreement_intervals_cover_the_ceiling_at_nominal_level() -> None:
    found = [
        measure_agreement(make_readings(40, seed=seed), Demand(tolerance=1.0)).figures
        for seed in range(20)
    ]
    ceilings = [one["r_squared_ceiling"] for one in found]
    assert 15 <= sum(one.low <= CEILING <= one.high for one in ceilings) <= 20


def test_agreement_without_repeats_has_no_ceiling() -> None:
    found = measure_agreement(make_readings(30, seed=2, sides=1), Demand(tolerance=1.0))
    assert math.isnan(found.figures["r_squared_ceiling"].value)
    assert found.figures["r_squared"].value > 0.5


@pytest.mark.slow
def test_estimate_effort_returns_readings_grasps_and_rate() -> None:
    demand = Demand(tolerance=1.0)
    found = measure_agreement(make_readings(1000, seed=3), demand)
    effort = estimate_effort(found, demand, grasp_s=10.0, handling_s=5.0)
    # (1.645 x 1.0 / 1.0)^2 = 2.7, and (1.645 x 0.4 / 1.0)^2 = 0.4.
    assert (effort.reference_readings, effort.grasps) == (3, 1)
    assert effort.items_per_hour == pytest.approx(240.0)
    assert effort.mismatch < 0.25


@given(
    slope=st.floats(-5.0, 5.0).filter(lambda value: abs(value) > 0.05),
    offset=st.floats(-10.0, 10.0),
    ratio=st.floats(0.01, 100.0),
)
def test_deming_lines_of_error_free_points_are_exact(
    slope: float, offset: float, ratio: float
) -> None:
    x = np.array([0.0, 1.0, 2.5, 4.0])
    found = deming_lines(x, offset + slope * x, ratio=ratio)
    assert tuple(map(float, found)) == pytest.approx((slope, offset), abs=1e-5)


@given(st.integers(0, 1000))
def test_estimate_scatter_is_independent_of_row_order(seed: int) -> None:
    readings = make_readings(12, seed=seed)
    order = np.random.default_rng(seed).permutation(readings.item.size)
    one = estimate_scatter(readings.reference, readings.item)
    other = estimate_scatter(readings.reference[order], readings.item[order])
    assert (one.between, one.within) == pytest.approx((other.between, other.within))


@pytest.mark.parametrize("kind", ["noise", "other quantity", "nearly constant"])
def test_grasps_without_a_relation_have_no_limit_of_agreement(kind: str) -> None:
    random = np.random.default_rng(5)
    item = np.repeat(np.arange(24), 2)
    firmness = random.normal(10.0, BETWEEN, 24)[item]
    grasps = {
        "noise": random.normal(50.0, 8.0, item.size),
        "other quantity": random.normal(50.0, 8.0, 24)[item] + random.normal(0.0, 0.1, item.size),
        "nearly constant": 50.0 + np.where(item == 3, 1e-9, 0.0),
    }
    reference = firmness + random.normal(0.0, REFERENCE_SD, item.size)
    readings = PairedReadings(item=item, reference=reference, grasp=grasps[kind])
    demand = Demand(tolerance=1.0, limits=(9.0, 11.0))
    found = measure_agreement(readings, demand)
    effort = estimate_effort(found, demand, grasp_s=15.0, handling_s=5.0)
    assert not found.is_related
    for name in ("limit_of_agreement", "share_within", "same_grade", "cost"):
        assert math.isnan(found.figures[name].value)
    assert (effort.grasps, effort.items_to_test, effort.items_per_hour) == (None, None, None)
    # The reference alone is still described.
    assert found.figures["r_squared_ceiling"].value > 0.5
    assert effort.reference_readings is not None


def test_cost_is_mean_misgrading_cost_per_graded_grasp() -> None:
    readings = make_readings(200, seed=4)
    demand = Demand(tolerance=1.0, limits=(9.0, 11.0), cost_high=5.0, cost_low=2.0)
    found = calculate_agreement(readings, demand)
    table = count_grades(found, demand.limits)
    assert (table.shape, table.sum()) == ((3, 3), 400)
    assert np.trace(table) / 400 == pytest.approx(found.figures["same_grade"].value)
    priced = np.array([[0, 5, 10], [2, 0, 5], [4, 2, 0]])
    cost = found.figures["cost"].value
    assert cost == pytest.approx((table * priced).sum() / table.sum())
    assert cost < found.figures["cost_reference"].value
