"""The paper's line: interval, and refused input."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.line_law import LineForceLaw


def test_line_interval_is_a_student_interval() -> None:
    rng = np.random.default_rng(5)
    inside = []
    relative = -np.linspace(5, 60, 12)
    for _ in range(200):
        truth = -0.1 * relative + 1
        law = LineForceLaw.fit(relative, force_n=truth + 0.2 * rng.standard_normal(12))
        answer = law.force_n(relative)
        new = truth + 0.2 * rng.standard_normal(12)
        inside.append((answer.low <= new) & (new <= answer.high))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.03)


def test_line_law_fit_refuses_saturated_readings() -> None:
    with pytest.raises(CalibrationError, match="saturated"):
        LineForceLaw.fit([-99.0] * 5, force_n=[1.0, 2, 3, 4, 5])
