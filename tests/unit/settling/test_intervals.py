"""Interval widths with and without calibration residuals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import stdtrit

from palpate.settling.intervals import DEFAULT_DEGREES, UNCALIBRATED, IntervalScale


def test_without_calibration_it_is_student_s_t() -> None:
    widths = UNCALIBRATED.half_widths(np.array([0.5, 5.0]), level=0.8)
    assert widths == pytest.approx(stdtrit(DEFAULT_DEGREES, 0.9))


def test_many_residuals_outweigh_the_default() -> None:
    residuals = np.linspace(0, 1, 1001)
    scale = IntervalScale(window_s=np.array([1.0]), residuals=(residuals,))
    assert scale.half_widths(np.array([1.0]), level=0.9)[0] == pytest.approx(0.9, abs=0.02)


def test_few_residuals_hardly_move_it() -> None:
    scale = IntervalScale(window_s=np.array([1.0]), residuals=(np.array([0.1, 0.2]),))
    default = UNCALIBRATED.half_widths(np.array([1.0]), level=0.9)[0]
    assert scale.half_widths(np.array([1.0]), level=0.9)[0] > 0.8 * default


def test_between_windows_it_is_between() -> None:
    residuals = (np.full(1000, 1.0), np.full(1000, 3.0))
    scale = IntervalScale(window_s=np.array([1.0, 4.0]), residuals=residuals)
    ends = scale.half_widths(np.array([1.0, 2.0, 4.0, 9.0]), level=0.9)
    assert ends[1] == pytest.approx((ends[0] + ends[2]) / 2)
    assert ends[3] == ends[2]
