"""The contact point of curves that are read through a law in doubt."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.size import contact_point


def interval(size: float, *, exponent: float, law: float, felt_n: float) -> tuple[float, float]:
    """Close on an object as a grasp does, read it through a law, and return the interval."""
    width = np.array([34.0, 33.0, 32.0, 31.0, 30.6, 30.3])
    true = 2.0 * np.maximum(size - width, 0.0) ** exponent
    force = np.where(true > felt_n, true**law, 0.0)
    found = contact_point(width, force_n=force, give_mm=0 * width, floor_n=0.1)
    low, high = found.quantile([0.05, 0.95]).tolist()
    return low, high


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("law", [0.8, 0.92, 1.05])
def test_a_law_whose_exponent_is_off_does_not_move_it_out(exponent: float, law: float) -> None:
    sizes = np.linspace(31.5, 32.5, 11)
    ends = [interval(s, exponent=exponent, law=law, felt_n=0.1) for s in sizes]
    inside = [low <= s <= high for s, (low, high) in zip(sizes, ends, strict=True)]
    assert np.mean(inside) >= 0.9


def test_a_place_that_feels_late_does_not_move_it_out() -> None:
    # About the weakest force that the calibration felt, and nothing felt here.
    size = 32.14
    assert 2.0 * (size - 32.0) ** 1.5 == pytest.approx(0.105, abs=0.001)
    low, high = interval(size, exponent=1.5, law=0.92, felt_n=0.2)
    assert low <= size <= high


def test_the_zero_of_the_gripper_is_never_sure() -> None:
    width = np.array([31.0, 30.5, 30.4, 30.3, 30.2, 30.1, 30.0])
    force = 200.0 * np.maximum(30.45 - width, 0.0)
    found = contact_point(width, force_n=force, give_mm=0 * width, floor_n=0.01)
    low, high = found.quantile([0.05, 0.95])
    # A block known to a tenth of a millimetre leaves a standard deviation of 0.06 mm.
    assert high - low >= 2 * 1.645 * 0.06 * 0.9
