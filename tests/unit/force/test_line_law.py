"""The paper's line: refused input, and coverage of its interval."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.force.line_law import LineForceLaw


@pytest.mark.parametrize(
    ("percent", "force_n", "message"),
    [
        ([-1.0, -2.0], [1.0, 2.0], "2 usable pairs"),
        ([-1.0, -2, -3, -4], [2.0, 2, 2, 2], "hardly changes"),
        ([-1.0, -2, float("nan"), -4], [1.0, 2, 3, 4], "not a finite number"),
    ],
)
def test_line_law_fit_invalid_pairs_are_refused(
    percent: list[float], force_n: list[float], message: str
) -> None:
    with pytest.raises(CalibrationError, match=message):
        LineForceLaw.fit(percent, force_n=force_n)


def test_line_interval_is_a_student_interval() -> None:
    rng, inside = np.random.default_rng(5), []
    relative = -np.linspace(5, 60, 12)
    for _ in range(200):
        first, new = -0.1 * relative + 1 + 0.2 * rng.standard_normal((2, 12))
        answer = LineForceLaw.fit(relative, force_n=first).force_n(relative)
        inside.append((answer.low <= new) & (new <= answer.high))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.03)


def test_line_law_fit_refuses_saturated_readings() -> None:
    with pytest.raises(CalibrationError, match="saturated"):
        LineForceLaw.fit([-99.0] * 5, force_n=[1.0, 2, 3, 4, 5])
