"""Static force laws: fit, refused input, and coverage of intervals."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.line_law import LineForceLaw

LOADS_N = np.linspace(0.5, 10.0, 15)


def scattered(
    seed: int, *, offset_n: float = 0.0, sd: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Return excess and loads of a power law with scatter in ln force."""
    rng = np.random.default_rng(seed)
    reading = (LOADS_N - offset_n) * np.exp(sd * rng.standard_normal(LOADS_N.size))
    return (reading / 0.2) ** 1.25, LOADS_N


def test_power_law_fit_finds_detection_threshold_only_if_there_is_one() -> None:
    excess, loads = scattered(1, offset_n=0.4, sd=0.01)
    _, exponent, offset_n = PowerForceLaw.fit(excess, force_n=loads).coefficients
    assert (exponent, offset_n) == (pytest.approx(0.8, abs=0.03), pytest.approx(0.4, abs=0.08))
    excess, loads = scattered(2)
    assert PowerForceLaw.fit(excess, force_n=loads).coefficients[2] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.5, 0.9])
def test_power_intervals_cover_new_readings_at_their_level(level: float) -> None:
    inside = []
    for seed in range(60):
        law = PowerForceLaw.fit(scattered(seed)[0], force_n=LOADS_N)
        answer = law.force_n(scattered(seed + 1000)[0], level=level)
        inside.append((answer.low <= LOADS_N) & (answer.high >= LOADS_N))
    assert np.mean(inside) == pytest.approx(level, abs=0.06)


@pytest.mark.parametrize(
    ("excess", "force_n", "message"),
    [
        ([1.0, 2.0], [1.0, 2.0], "2 usable pairs"),
        ([1.0, 2, 3, 4], [2.0, 2, 2, 2], "hardly changes"),
        ([4.0, 3, 2, 1], [1.0, 2, 3, 4], "does not rise with the load"),
        ([3.0, 3, 3, 3], [1.0, 2, 3, 4], "does not rise with the load"),
        ([1.0, 2, float("nan"), 4], [1.0, 2, 3, 4], "not a finite number"),
        ([-1.0, -2, -3, -4], [1.0, 2, 3, 4], "0 usable pairs"),
    ],
)
def test_law_fit_invalid_pairs_are_refused(
    excess: list[float], force_n: list[float], message: str
) -> None:
    with pytest.raises(CalibrationError, match=message):
        PowerForceLaw.fit(excess, force_n=force_n)


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
