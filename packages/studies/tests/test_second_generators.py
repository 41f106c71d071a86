"""Simulated fruit and sheets: bruises, scatter as of real food, and second generators."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest
from sklearn.discriminant_analysis import QuadraticDiscriminantAnalysis

from palpate.arrays import FloatArray
from palpate.holds import read_holds
from palpate.twin.crate import CRATE_SIDE_LOG_SD, TRAINED_KINDS, draw_crate
from palpate_studies.fruit_ranges import AVOCADO_BOUNDS_N, AVOCADO_STAGES, AVOCADOS
from palpate_studies.twin_apple import Faces, draw_apple
from palpate_studies.twin_avocado import draw_avocado


def side_log_sd(first: FloatArray, second: FloatArray) -> float:
    """Return the scatter of one side about the mean of both, ln."""
    return float(np.std(np.log(first / second)) / np.sqrt(2.0))


@pytest.fixture(scope="module")
def real_side_log_sd(real_data: Path) -> float:
    with gzip.open(real_data / "apples_firmness.csv.gz", "rt", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    pairs = [(row["side1_lbf"], row["side2_lbf"]) for row in rows]
    sides = np.array([pair for pair in pairs if all(pair) and "NA" not in pair], dtype=float)
    assert len(sides) > 700
    return side_log_sd(sides[:, 0], sides[:, 1])


@pytest.mark.slow
def test_twin_apple_side_scatter_matches_real_apples(real_side_log_sd: float) -> None:
    random = np.random.default_rng(1)
    apples = [draw_apple(random, bruises=None) for _ in range(2000)]
    faces = [apple.facing(0.0).faces for apple in apples]
    firmness = np.array(
        [[f.firmness for f in two.faces] for two in faces if isinstance(two, Faces)]
    )
    twin = side_log_sd(firmness[:, 0], firmness[:, 1])
    assert real_side_log_sd <= twin <= 1.1 * real_side_log_sd


def test_other_twin_fruit_side_scatter_is_at_least_that_of_apples(real_side_log_sd: float) -> None:
    assert min(CRATE_SIDE_LOG_SD, AVOCADOS.spot_log_sd) >= real_side_log_sd


def test_real_food_relaxation_is_within_range_of_twin_fruit(real_data: Path) -> None:
    lost = []
    for hold in read_holds(real_data / "holds_food.csv.gz"):
        peak = int(np.argmax(hold.values))
        after = np.interp(hold.time_s[peak] + 20.0, hold.time_s, hold.values)
        lost.append(1.0 - after / hold.values[peak])
    twin = []
    for item in draw_crate([kind for kind in TRAINED_KINDS if kind != "egg"] * 20, seed=1):
        share, time = np.array(item.mean.relaxing_fractions), np.array(item.mean.relaxing_time_s)
        twin.append(float((share * -np.expm1(-20.0 / time)).sum()))
    low, high = np.quantile(twin, [0.05, 0.95])
    assert low <= min(lost)
    assert max(lost) <= high
    assert np.std(twin) > np.std(lost)


@pytest.mark.parametrize(("places", "exact"), [(1, 0.944), (10, 0.982)])
def test_stage_accuracy_ceiling_matches_results_page(places: int, exact: float) -> None:
    """The ceiling stated in docs/results.md."""
    random = np.random.default_rng(5)
    hits = []
    for _ in range(1000):
        fruit = draw_avocado(random)
        for day in range(4):
            error = AVOCADOS.spot_log_sd * random.standard_normal(places).mean()
            read_n = fruit.force_at_1mm_n(day) * np.exp(error)
            passed = sum(read_n < bound for bound in AVOCADO_BOUNDS_N)
            hits.append(AVOCADO_STAGES[passed] == fruit.stage(day))
    assert np.mean(hits) == pytest.approx(exact, abs=0.012)


def test_kind_accuracy_ceiling_matches_results_page() -> None:
    """The ceiling stated in docs/results.md."""

    def read(items: int, seed: int) -> tuple[FloatArray, list[str]]:
        drawn = draw_crate(list(TRAINED_KINDS) * items, seed=seed)
        sides = [item.side(0) for item in drawn]
        pressed_mm = [(2.0 / side.force_at_1mm_n) ** (1.0 / side.exponent) for side in sides]
        values = np.log([(s.size_mm, 2.0 / x) for s, x in zip(sides, pressed_mm, strict=True)])
        return values, [item.kind for item in drawn]

    learned = QuadraticDiscriminantAnalysis().fit(*read(200, 11))
    assert learned.score(*read(100, 12)) == pytest.approx(0.94, abs=0.02)
