"""Intervals of a non-negative quantity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student_t

from palpate.object.feldman_cousins import interval_above_zero, median_above_zero

#: Feldman and Cousins (1998), Table X: measured, ends of the 90 % interval of a normal error.
TABLE_X = [
    (-3.0, 0.00, 0.26),
    (-1.0, 0.00, 0.81),
    (0.0, 0.00, 1.64),
    (1.0, 0.00, 2.64),
    (2.0, 0.58, 3.64),
    (3.0, 1.37, 4.64),
]


def test_interval_above_zero_matches_published_table() -> None:
    for measured, low, high in TABLE_X:
        found = interval_above_zero(measured, freedom=1e6, level=0.9)
        assert found == pytest.approx((low, high), abs=0.04), measured


def test_interval_above_zero_far_from_zero_is_ordinary_interval() -> None:
    low, high = interval_above_zero(8.0, freedom=6, level=0.9)
    reach = student_t.ppf(0.95, 6)
    assert (low, high) == pytest.approx((8.0 - reach, 8.0 + reach), abs=0.06)


@pytest.mark.parametrize("true", [0.0, 0.5, 1.5, 4.0])
def test_interval_above_zero_coverage_equals_level(true: float) -> None:
    error = student_t.ppf((np.arange(100) + 0.5) / 100, 6)
    ends = [interval_above_zero(true + one, freedom=6, level=0.9) for one in error]
    assert np.mean([low <= true <= high for low, high in ends]) == pytest.approx(0.9, abs=0.03)


def test_median_above_zero_is_inside_interval_and_halves_remaining_probability() -> None:
    for measured in np.linspace(-6.0, 6.0, 7):
        low, high = interval_above_zero(measured, freedom=6, level=0.9)
        assert low <= median_above_zero(measured, freedom=6) < high
    middle = median_above_zero(0.5, freedom=1e6)
    assert norm.sf(middle - 0.5) == pytest.approx(0.5 * norm.cdf(0.5), rel=1e-4)
