"""Current law, contact gain and soft fingers: refused input, and uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.compliance import SoftFingerCompliance
from palpate.estimate.force import ForceEstimate
from palpate.estimate.gain import Gain, MeasuredForce
from palpate.estimate.servo_force import _THRESHOLD_N, CurrentLaw, GearFriction
from palpate.sensor.calibration import CurrentPairs


def pairs(*, ma_per_n: float = 16.0, noise_ma: float = 6.0, count: int = 200) -> CurrentPairs:
    rng = np.random.default_rng(5)
    force_n = np.linspace(0.0, 12.0, count)
    current_ma = 40.0 + ma_per_n * force_n + noise_ma * rng.standard_normal(count)
    return CurrentPairs(force_n=tuple(force_n.tolist()), current_ma=tuple(current_ma.tolist()))


def test_current_law_fit_recovers_law_from_noisy_readings() -> None:
    law = CurrentLaw.fit(pairs())
    assert law.gears.mean_ma == pytest.approx(40.0, abs=2.0)
    assert law.gears.movement_ma == pytest.approx(6.0, abs=0.5), (
        "the assumed value without an empty-hand calibration"
    )
    assert law.ma_per_n == pytest.approx(16.0, rel=0.02)
    assert law.noise_ma == pytest.approx(6.0, rel=0.15)


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


def test_current_pairs_of_unequal_length_are_refused() -> None:
    with pytest.raises(CalibrationError, match="force_n has 2 values, but current_ma has 1"):
        CurrentPairs(force_n=(1.0, 2.0), current_ma=(50.0,))
    with pytest.raises(CalibrationError, match="finite"):
        CurrentPairs(force_n=(1.0,), current_ma=(float("nan"),))


def test_current_pairs_with_short_widths_or_without_movements_are_refused() -> None:
    with pytest.raises(CalibrationError, match="force_n has 2 values, but width_mm has 1"):
        CurrentPairs(force_n=(1.0, 2.0), current_ma=(5.0, 6.0), width_mm=(1.0,), movement=(0, 0))
    with pytest.raises(CalibrationError, match="give both"):
        CurrentPairs(force_n=(1.0,), current_ma=(5.0,), width_mm=(1.0,))


def test_current_law_measure_equals_the_solution_with_the_whole_covariance_matrix() -> None:
    rng = np.random.default_rng(6)
    movement = np.repeat([0, 1, 2], [40, 3, 17])
    fraction = np.sort(rng.uniform(0.1, 1.0, movement.size))
    current_ma = 40.0 + 80.0 * fraction + rng.normal(0.0, 6.0, movement.size)
    law = geared(movement_ma=9.0)
    found = law.measure(
        current_ma, fraction=fraction, width_mm=30.0 - 5.0 * fraction, movement=movement
    )
    assert found is not None
    force_n = (current_ma - law.gears.mean_ma) / law.ma_per_n
    design = np.column_stack([fraction, 1.0 - fraction])
    end_n = 0.0
    for _ in range(2):
        moved_n = law.gears.movement_ma / law.ma_per_n
        moved_n = moved_n * (1.0 + law._load_fraction(end_n) * fraction)
        scatter = (law.noise_ma / law.ma_per_n) ** 2 * np.eye(movement.size)
        scatter += np.equal.outer(movement, movement) * np.outer(moved_n, moved_n)
        weighed = np.linalg.solve(scatter, design)
        prior = np.diag([0.0, 1.0 / _THRESHOLD_N**2])
        covariance = np.linalg.inv(design.T @ weighed + prior)
        end_n = float((covariance @ (weighed.T @ force_n))[0])
    assert found.force_n == pytest.approx(end_n, rel=1e-9)
    mean_sd_n = law.gears.mean_sd_ma / law.ma_per_n
    assert found.sd_n == pytest.approx(np.hypot(np.sqrt(covariance[0, 0]), mean_sd_n), rel=1e-9)


def geared(*, movement_ma: float) -> CurrentLaw:
    gears = GearFriction(mean_ma=40.0, mean_sd_ma=0.0, movement_ma=movement_ma)
    return CurrentLaw(gears=gears, ma_per_n=16.0, noise_ma=6.0)


@pytest.mark.parametrize("movement_ma", [0.0, 8.0])
def test_current_law_stated_uncertainty_matches_errors(movement_ma: float) -> None:
    law = geared(movement_ma=movement_ma)
    rng, fraction = np.random.default_rng(7), np.linspace(0.1, 1.0, 15)
    movement = np.repeat(np.arange(3), 5)
    found = [
        law.measure(
            40.0
            + 16.0 * 3.0 * fraction
            + 6.0 * rng.standard_normal(15)
            + (movement_ma * rng.standard_normal(3))[movement],
            fraction=fraction,
            width_mm=np.full(15, 30.0),
            movement=movement,
        )
        for _ in range(400)
    ]
    forces = np.array([one.force_n for one in found if one is not None])
    assert len(forces) == 400
    assert forces.mean() == pytest.approx(3.0, abs=0.05)
    assert forces.std() == pytest.approx(found[0].sd_n if found[0] else 0.0, rel=0.1)


def test_current_law_without_reading_under_load_returns_none() -> None:
    law = CurrentLaw.fit(pairs())
    assert law.measure([], fraction=[], width_mm=[], movement=[]) is None
    assert law.measure([45.0], fraction=[0.0], width_mm=[30.0], movement=[0]) is None


def closed_empty(*, movement_sd: float, seed: int = 3) -> CurrentPairs:
    """Return two long and forty short closings with a friction of 36 to 44 mA."""
    rng = np.random.default_rng(seed)
    runs = [np.linspace(70.0, 10.0, 400)] * 2
    runs += [np.linspace(70.0 - 1.5 * k, 68.6 - 1.5 * k, 7) for k in range(40)]
    factors = np.exp(movement_sd * rng.standard_normal(len(runs)))
    currents = [
        factor * (40.0 + 4.0 * np.sin(width / 2.0)) + 6.0 * rng.standard_normal(width.size)
        for width, factor in zip(runs, factors, strict=True)
    ]
    return CurrentPairs(
        force_n=(0.0,) * sum(run.size for run in runs),
        current_ma=tuple(np.concatenate(currents).tolist()),
        width_mm=tuple(np.concatenate(runs).tolist()),
        movement=tuple(np.repeat(np.arange(len(runs)), [run.size for run in runs]).tolist()),
    )


@pytest.mark.parametrize("movement_sd", [0.0, 0.15])
def test_gear_friction_fit_separates_position_and_movement_parts(
    movement_sd: float,
) -> None:
    found = GearFriction.fit(closed_empty(movement_sd=movement_sd))
    width_mm = np.linspace(15.0, 65.0, 200)
    assert found.mean_ma == pytest.approx(40.0, abs=max(3 * found.mean_sd_ma, 1.0))
    shape = found.mean_current_ma(width_mm) - found.mean_ma
    assert np.corrcoef(shape, np.sin(width_mm / 2.0))[0, 1] > 0.8
    assert found.movement_ma == pytest.approx(40.0 * movement_sd, abs=1.6)


def test_current_law_slope_is_independent_of_movement_offsets() -> None:
    """Two closings to different forces; the one to the larger force has more friction."""
    force_n = np.concatenate([np.linspace(0.0, 4.0, 40), np.linspace(0.0, 8.0, 80)])
    movement = np.repeat([0, 1], [40, 80])
    law = CurrentLaw.fit(
        CurrentPairs(
            force_n=tuple(force_n.tolist()),
            current_ma=tuple((np.array([40.0, 80.0])[movement] + 16.0 * force_n).tolist()),
            width_mm=tuple((50.0 - 4.0 * force_n).tolist()),
            movement=tuple(movement.tolist()),
        )
    )
    assert law.ma_per_n == pytest.approx(16.0, rel=1e-3)


def test_gain_update_weights_by_uncertainty() -> None:
    measured = MeasuredForce(force_n=4.0, sd_n=0.05, log_sd=0.0)
    from_sheet = Gain.from_calibration(law_sd=0.5).update(measured, sheet_n=2.0)
    assert np.exp(from_sheet.log_mean) == pytest.approx(2.0, rel=0.03)
    assert from_sheet.log_sd < 0.05
    sure = Gain.from_calibration(law_sd=0.02).update(
        MeasuredForce(force_n=4.0, sd_n=3.0, log_sd=0.0), sheet_n=2.0
    )
    assert abs(sure.log_mean) < 0.01
    assert sure.log_sd == pytest.approx(0.02, rel=0.05)


def test_gain_update_is_robust_to_outlier() -> None:
    """A movement may need three times the usual current; the sheet's error is smaller."""
    sheet = Gain.from_calibration(law_sd=0.1)

    def mean(force_n: float) -> float:
        measured = MeasuredForce(force_n=force_n, sd_n=0.2, log_sd=0.0)
        return sheet.update(measured, sheet_n=2.0).log_mean

    assert 0.0 < mean(2.2) < mean(2.4)
    assert mean(2.2) / 0.2 > 3 * mean(4.0) / 2.0


def test_gain_from_calibration_preserves_law_and_widens_with_uncertainty() -> None:
    said = ForceEstimate(
        value=np.array([0.0, 2.0]),
        low=np.array([0.0, 1.8]),
        high=np.array([0.3, 2.3]),
        in_range=np.array([False, True]),
        level=0.9,
    )
    same = Gain.from_calibration(law_sd=0.05).apply_to(said)
    assert same.value.tolist() == said.value.tolist()
    assert same.high == pytest.approx(said.high)
    assert same.low == pytest.approx(said.low)
    wide = Gain.from_calibration(law_sd=0.05, additional_sd=0.2).apply_to(said)
    assert wide.high[1] > 2.7
    assert wide.low[1] < 1.5
    assert wide.high[0] == 0.3


def test_soft_finger_compliance_fit_refuses_blocks_of_one_size() -> None:
    force_n = np.linspace(0.5, 6.0, 8)
    with pytest.raises(CalibrationError, match="two sizes"):
        SoftFingerCompliance.fit(24.0 + 2.6 * force_n, force_n=force_n, block_mm=np.full(8, 40.0))
    sizes = np.repeat([40.0, 50.0], 4)
    with pytest.raises(CalibrationError, match="higher pressure"):
        SoftFingerCompliance.fit(sizes + force_n, force_n=force_n, block_mm=sizes)
