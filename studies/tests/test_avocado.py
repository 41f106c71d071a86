"""Simulated avocados ripen within their ranges."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from palpate_studies.fruit_ranges import AVOCADO_BOUNDS_N, AVOCADO_STAGES, AVOCADOS
from palpate_studies.twin_avocado import Avocado, draw_avocado


@pytest.fixture(scope="module")
def fruits() -> list[Avocado]:
    rng = np.random.default_rng(5)
    return [draw_avocado(rng) for _ in range(200)]


def test_avocado_firmness_decreases_every_day(fruits: list[Avocado]) -> None:
    for fruit in fruits:
        firmness = [fruit.force_at_1mm_n(day) for day in np.arange(-3.0, 14.0, 0.25)]
        assert (np.diff(firmness) < 0).all()
        assert AVOCADOS.softest_n_log[0] < firmness[-1] < firmness[0] < AVOCADOS.hard_n_log[1]


def test_day_of_stage_matches_stage_boundary(fruits: list[Avocado]) -> None:
    for fruit in fruits[:20]:
        for stage, bound in zip(AVOCADO_STAGES[1:], AVOCADO_BOUNDS_N, strict=True):
            day = fruit.day_of(stage)
            assert fruit.force_at_1mm_n(day) == pytest.approx(bound, rel=1e-4)
            assert fruit.stage(day + 1e-3) == stage
            assert fruit.stage(day - 1e-3) != stage
        assert fruit.day_of("hard") == -np.inf


def test_avocados_on_four_days_include_all_stages(fruits: list[Avocado]) -> None:
    seen = Counter(fruit.stage(day) for fruit in fruits for day in range(4))
    assert set(seen) == set(AVOCADO_STAGES)
    assert min(seen.values()) > 0.05 * sum(seen.values())


def test_spots_of_avocado_scatter_and_withstand_grip_force(
    fruits: list[Avocado],
) -> None:
    rng = np.random.default_rng(6)
    spots = [fruits[0].spot(1.0, rng=rng) for _ in range(400)]
    ratio = np.array([spot.force_at_1mm_n for spot in spots]) / fruits[0].force_at_1mm_n(1.0)
    assert np.std(np.log(ratio)) == pytest.approx(AVOCADOS.spot_log_sd, rel=0.15)
    assert np.std([spot.size_mm for spot in spots]) == pytest.approx(AVOCADOS.waist_sd_mm, rel=0.15)
    softest = [fruit.spot(9.0, rng=rng) for fruit in fruits]
    assert min(spot.yield_n for spot in softest) > 5.0
