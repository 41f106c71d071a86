"""Values and bounds of measurements."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.grasp.verdict import firmness
from palpate.measurement import Measurement, Status


def stiffness(low: float, high: float) -> Measurement:
    found = Measurement(value=(low * high) ** 0.5, low=low, high=high, unit="n_per_mm")
    return found.or_bound("it gave way too little", least=0.02, most=500.0)


@pytest.mark.parametrize(
    ("low", "high", "status", "ends", "word"),
    [
        (2.0, 8.0, "ok", (2.0, 8.0), "soft to medium"),
        (2.0, 8.1, "at_least", (2.0, None), "at least soft"),
        (0.36, 500.0, "at_least", (0.36, None), "firmness not measured"),
        (0.02, 0.5, "at_most", (None, 0.5), "very soft"),
        (0.02, 500.0, "not_measured", (None, None), "firmness not measured"),
        (0.0, 1.0, "at_most", (None, 1.0), "very soft"),
    ],
)
def test_or_bound_returns_value_or_bound(
    low: float, high: float, status: str, ends: tuple[float | None, ...], word: str
) -> None:
    found = stiffness(low, high)
    said = found.to_dict()
    assert (said["low"], said["high"]) == ends == found.known_ends
    assert said["status"] == status
    assert (said["value"] is None) == (found.value is None) == (status != "ok")
    assert found.middle == pytest.approx((low * high) ** 0.5 if found.has_value or low > 0 else 0.5)
    assert (said["reason"] is None) == (status == "ok")
    assert firmness(found) == word


@pytest.mark.parametrize("level", [0.5, 0.8, 0.9, 0.99])
def test_interval_of_a_standard_deviation_gives_it_back(level: float) -> None:
    force = Measurement.from_log_sd(3.0, log_sd=0.2, unit="n", level=level)
    assert force.log_sd == pytest.approx(0.2)
    assert force.probability_below(force.low) == pytest.approx((1 - level) / 2)
    assert force.probability_below(force.high) == pytest.approx((1 + level) / 2)
    drawn = np.exp(np.log(3.0) + 0.2 * np.random.default_rng(1).standard_normal(100_000))
    assert np.mean((drawn > force.low) & (drawn < force.high)) == pytest.approx(level, abs=0.005)


def test_interval_of_samples_covers_its_level() -> None:
    drawn = np.random.default_rng(2).normal(5.0, 1.0, 20_000)
    # The second half of the samples has no weight.
    weight = np.repeat([1.0, 0.0], 10_000)
    drawn[10_000:] += 100.0
    found = Measurement.from_samples(drawn, weight=weight, unit="mm", level=0.8)
    assert found.value == pytest.approx(5.0, abs=0.05)
    assert found.side_sds == pytest.approx((1.0, 1.0), abs=0.05)


def test_uncertainties_add_as_squares_and_never_narrow() -> None:
    size = Measurement(value=40.0, low=39.0, high=43.0, unit="mm")
    wide = size.widened(sd=size.side_sds[1])
    assert wide.high - 40.0 == pytest.approx(3.0 * math.sqrt(2.0))
    assert wide.low < size.low
    assert wide.value == 40.0


def test_falling_function_exchanges_the_limits() -> None:
    stiffness = Measurement(value=None, low=2.0, high=8.0, unit="n_per_mm", status=Status.AT_LEAST)
    softness = stiffness.mapped(lambda one: 1.0 / one, unit="mm_per_n")
    assert softness.known_ends == (None, 0.5)
    assert softness.unit == "mm_per_n"
    known = replace(stiffness, value=4.0, status=Status.OK).mapped(lambda one: -one, unit="x")
    assert known.low < -4.0 < known.high


def test_combination_of_unequal_measurements_covers_both_values() -> None:
    one = Measurement.from_log_sd(2.0, log_sd=0.05, unit="n")
    other = Measurement.from_log_sd(4.0, log_sd=0.05, unit="n")
    both = one.combined(other, least=1e-3)
    assert both.value == pytest.approx(math.sqrt(8.0))
    assert both.low < 2.0 < 4.0 < both.high
    assert other.combined(one, least=1e-3).log_sd == pytest.approx(both.log_sd)
    assert one.combined(one, least=1e-3).log_sd == pytest.approx(one.log_sd)


def test_quantity_without_a_lower_limit_has_a_finite_log_sd_unless_it_is_zero() -> None:
    weak = Measurement(value=0.1, low=0.0, high=0.3, unit="n")
    assert 1.0 < weak.log_sd < 10.0
    assert math.isinf(replace(weak, value=0.0).log_sd)
