"""Interval widths with and without calibration residuals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

from palpate.settling.intervals import UNCALIBRATED, WIDENING, IntervalScale

NORMAL = float(ndtri(0.95))


def test_without_calibration_it_is_wider_by_a_constant() -> None:
    assert (
        UNCALIBRATED.widening(0.5, level=0.8) == UNCALIBRATED.widening(5.0, level=0.9) == WIDENING
    )


def test_many_residuals_outweigh_the_default() -> None:
    residuals = np.linspace(0, 1, 1001)
    scale = IntervalScale(window_s=np.array([1.0]), residuals=(residuals,))
    assert scale.widening(1.0, level=0.9) * NORMAL == pytest.approx(0.9, abs=0.03)


def test_few_residuals_hardly_move_it() -> None:
    scale = IntervalScale(window_s=np.array([1.0]), residuals=(np.array([0.1, 0.2]),))
    assert scale.widening(1.0, level=0.9) > 0.8 * WIDENING


def test_between_windows_it_is_between() -> None:
    residuals = (np.full(1000, 1.0), np.full(1000, 3.0))
    scale = IntervalScale(window_s=np.array([1.0, 4.0]), residuals=residuals)
    ends = [scale.widening(window_s, level=0.9) for window_s in (1.0, 2.0, 4.0, 9.0)]
    assert ends[1] == pytest.approx((ends[0] + ends[2]) / 2)
    assert ends[3] == ends[2]
