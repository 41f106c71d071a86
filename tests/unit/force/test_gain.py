"""Law of the servo current, friction of the gears, and contact gain: errors and refused input."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.calibration import CurrentPairs
from palpate.errors import CalibrationError
from palpate.force.servo_force import CurrentLaw, GearFriction


def pairs(*, ma_per_n: float = 16.0, count: int = 200) -> CurrentPairs:
    force_n = np.linspace(0.0, 12.0, count)
    noise_ma = 6.0 * np.random.default_rng(5).standard_normal(count)
    current_ma = 40.0 + ma_per_n * force_n + noise_ma
    return CurrentPairs(force_n=tuple(force_n.tolist()), current_ma=tuple(current_ma.tolist()))


def test_current_law_fit_recovers_law_from_noisy_readings() -> None:
    law = CurrentLaw.fit(pairs())
    assert law.gears.mean_ma == pytest.approx(40.0, abs=2.0)
    # The assumed value without an empty-hand calibration.
    assert law.gears.movement_ma == pytest.approx(6.0, abs=0.5)
    assert law.ma_per_n == pytest.approx(16.0, rel=0.02)
    assert law.noise_ma == pytest.approx(6.0, rel=0.15)
    # Without a reading under load there is no force.
    assert law.measure([], fraction=[], width_mm=[], movement=[]) is None
    assert law.measure([45.0], fraction=[0.0], width_mm=[30.0], movement=[0]) is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (pairs(count=5), "5 readings"),
        (CurrentPairs(force_n=(), current_ma=()), "0 readings over 0.0 N"),
        (pairs(ma_per_n=-16.0), "must rise with the force"),
    ],
)
def test_current_law_fit_refuses_invalid_pairs(given: CurrentPairs, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        CurrentLaw.fit(given)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"force_n": (1.0, 2.0)}, "force_n has 2 values, but current_ma has 1"),
        ({"current_ma": (float("nan"),)}, "finite"),
        ({"width_mm": (1.0, 2.0), "movement": (0,)}, "force_n has 1 values, but width_mm has 2"),
        ({"width_mm": (1.0,)}, "give both"),
    ],
)
def test_inconsistent_current_pairs_are_refused(columns: dict[str, tuple], words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        CurrentPairs(**({"force_n": (1.0,), "current_ma": (50.0,)} | columns))


@pytest.mark.parametrize("movement_ma", [0.0, 8.0])
def test_current_law_stated_uncertainty_matches_errors(movement_ma: float) -> None:
    gears = GearFriction(mean_ma=40.0, mean_sd_ma=0.0, movement_ma=movement_ma)
    law = CurrentLaw(gears=gears, ma_per_n=16.0, noise_ma=6.0)
    rng, fraction = np.random.default_rng(7), np.linspace(0.1, 1.0, 15)
    movement = np.repeat(np.arange(3), 5)
    width_mm, found = np.full(15, 30.0), []
    for _ in range(400):
        current_ma = 40.0 + 16.0 * 3.0 * fraction + 6.0 * rng.standard_normal(15)
        current_ma += (movement_ma * rng.standard_normal(3))[movement]
        found.append(
            law.measure(current_ma, fraction=fraction, width_mm=width_mm, movement=movement)
        )
    forces = np.array([one.force_n for one in found])
    assert forces.mean() == pytest.approx(3.0, abs=0.05)
    assert forces.std() == pytest.approx(found[0].sd_n, rel=0.1)
