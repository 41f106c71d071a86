"""Law of the servo current, friction of the gears, and contact gain: errors and refused input."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.gain import Gain, MeasuredForce
from palpate.estimate.servo_force import CurrentLaw, GearFriction
from palpate.sensor.calibration import CurrentPairs


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


@pytest.mark.parametrize("movement_sd", [0.0, 0.15])
def test_gear_friction_fit_separates_position_and_movement_parts(movement_sd: float) -> None:
    """Two long and forty short closings without an object, with a friction of 36 to 44 mA."""
    rng = np.random.default_rng(3)
    runs = [np.linspace(70.0, 10.0, 400)] * 2
    runs += [np.linspace(70.0 - 1.5 * k, 68.6 - 1.5 * k, 7) for k in range(40)]
    factors = np.exp(movement_sd * rng.standard_normal(len(runs)))
    currents = [
        factor * (40.0 + 4.0 * np.sin(width / 2.0)) + 6.0 * rng.standard_normal(width.size)
        for width, factor in zip(runs, factors, strict=True)
    ]
    sizes = [run.size for run in runs]
    closed_empty = CurrentPairs(
        force_n=(0.0,) * sum(sizes),
        current_ma=tuple(np.concatenate(currents).tolist()),
        width_mm=tuple(np.concatenate(runs).tolist()),
        movement=tuple(np.repeat(np.arange(len(runs)), sizes).tolist()),
    )
    found = GearFriction.fit(closed_empty)
    width_mm = np.linspace(15.0, 65.0, 200)
    assert found.mean_ma == pytest.approx(40.0, abs=max(3 * found.mean_sd_ma, 1.0))
    shape = found.mean_current_ma(width_mm) - found.mean_ma
    assert np.corrcoef(shape, np.sin(width_mm / 2.0))[0, 1] > 0.8
    assert found.movement_ma == pytest.approx(40.0 * movement_sd, abs=1.6)


def test_current_law_slope_is_independent_of_movement_offsets() -> None:
    """Two closings to different forces; the one to the larger force has more friction."""
    force_n = np.concatenate([np.linspace(0.0, 4.0, 40), np.linspace(0.0, 8.0, 80)])
    movement = np.repeat([0, 1], [40, 80])
    current_ma = np.array([40.0, 80.0])[movement] + 16.0 * force_n
    columns = {"force_n": force_n, "current_ma": current_ma, "width_mm": 50.0 - 4.0 * force_n}
    columns["movement"] = movement
    law = CurrentLaw.fit(CurrentPairs(**{k: tuple(v.tolist()) for k, v in columns.items()}))
    assert law.ma_per_n == pytest.approx(16.0, rel=1e-3)


def updated(*, law_sd: float, force_n: float, sd_n: float) -> Gain:
    """Return the gain after a force was measured where the sheet reads 2 N."""
    measured = MeasuredForce(force_n=force_n, sd_n=sd_n, log_sd=0.0)
    return Gain.from_calibration(law_sd=law_sd).update(measured, sheet_n=2.0)


def test_gain_update_weights_by_uncertainty() -> None:
    vague, sure = (
        updated(law_sd=0.5, force_n=4.0, sd_n=0.05),
        updated(law_sd=0.02, force_n=4.0, sd_n=3.0),
    )
    assert np.exp(vague.log_mean) == pytest.approx(2.0, rel=0.03)
    assert vague.log_sd < 0.05
    assert abs(sure.log_mean) < 0.01
    assert sure.log_sd == pytest.approx(0.02, rel=0.05)


def test_gain_update_is_robust_to_outlier() -> None:
    """A movement may need three times the usual current; the sheet's error is smaller."""
    small, more, wild = (
        updated(law_sd=0.1, force_n=force_n, sd_n=0.2).log_mean for force_n in (2.2, 2.4, 4.0)
    )
    assert 0.0 < small < more
    assert small / 0.2 > 3 * wild / 2.0
