"""Size and stiffness from a closing curve, with their intervals; compliance of the gripper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student_t

from palpate.errors import CalibrationError
from palpate.measurement import Measurement, Status
from palpate.object.closing_curve import CONTACT_SD, ClosingSteps, measure_closing
from palpate.object.compliance import STIFFEST_N_PER_MM, Compliance, SoftFingerCompliance
from palpate.object.soft_stiffness import measure_soft_stiffness
from palpate.object.strength import ClosingCurve

HARD = Compliance(
    slope_mm_per_n=1e-4, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.0, largest_force_n=15.0
)
HAND = replace(HARD, slope_mm_per_n=0.2, pad_mm=(0.0, 0.0, 0.3, 0.0, 0.0), residual_mm=0.02)
SOFT = replace(HARD, slope_mm_per_n=3.5, residual_mm=0.1)
FORCE_N = np.array([0.0, 0.6, 1.2, 2.0, 3.0, 4.5, 6.0])


def close(
    width_mm: np.ndarray,
    force_n: np.ndarray,
    *,
    measure: Callable[..., Any] = measure_closing,
    compliance: Compliance = HAND,
    half: float = 0.07,
    **sds: float,
) -> Any:
    """Close with these forces; the last is known to `half` of it."""
    steps = {"gain_sd": 0.03, "law_sd": 0.05, "floor_n": 0.1} | sds
    steps |= {"weak_n": CONTACT_SD * steps["floor_n"]}
    curve = ClosingSteps(width_mm=width_mm, force_n=force_n, **steps)
    held_n = float(force_n[-1])
    ends = {"low": held_n * (1 - half), "high": held_n * (1 + half)}
    held = Measurement(value=held_n, **ends, unit="n", level=0.9)
    return measure(curve, compliance=compliance, opening_mm=float(width_mm[-1]), force=held)


def stiffness_of(
    n_per_mm: float, *, gain: float = 1.0, drift_n: Any = (), **how: Any
) -> Measurement:
    """Close on a spring; `gain` scales all forces, `drift_n` is read before contact."""
    opening = 40.0 - FORCE_N / n_per_mm - HAND.deflection_mm(FORCE_N)
    width = np.concatenate([40.0 + np.arange(len(drift_n), 0, -1), opening])
    found = close(width, np.concatenate([drift_n, gain * FORCE_N]), **how)
    return found.stiffness


@pytest.mark.parametrize("n_per_mm", [0.5, 1.5, 4.0])
def test_stiffness_of_soft_object_is_within_a_tenth(n_per_mm: float) -> None:
    found = stiffness_of(n_per_mm)
    assert found.value == pytest.approx(n_per_mm, rel=0.1)
    assert found.low < n_per_mm < found.high < 2 * found.low


def test_stiffness_interval_covers_relaxation_that_the_force_allows() -> None:
    found = stiffness_of(2.0, gain_sd=0.01, law_sd=0.03, floor_n=0.05, half=0.1)
    # A fruit lost 6 % of its force undetected; the fingers closed further accordingly.
    opening_mm = 40.0 - 6.0 / 2.0 - HAND.deflection_mm(6.0)
    relaxed = 0.94 * 6.0 / float(40.0 - opening_mm - HAND.deflection_mm(0.94 * 6.0))
    assert found.low < relaxed < 0.95 * 2.0 < 2.0 < found.high


def test_stiffness_interval_with_gain_uncertainty_covers_gain_error() -> None:
    assert stiffness_of(2.0, gain=1.3).low > 2.0
    uncertain = stiffness_of(2.0, gain=1.3, gain_sd=0.3, half=0.4)
    assert uncertain.low < 2.0 < uncertain.high


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_closing_stiffness_is_that_of_the_upper_half_before_the_object_relaxes(
    exponent: float,
) -> None:
    deformed_mm = (FORCE_N / 2.0) ** (1 / exponent)
    width_mm = 40.0 - deformed_mm - HAND.deflection_mm(FORCE_N)
    found = close(width_mm, FORCE_N, half=0.02, gain_sd=0.01, law_sd=0.02, floor_n=0.02).closing
    # As a damage model is trained: over the upper half of the force, from a recorded closing.
    curve = ClosingCurve()
    fine_mm = np.linspace(0.0, deformed_mm[-1], 500)
    states = [s for x in fine_mm for s in curve.push(float(x), force_n=float(2 * x**exponent))]
    assert found.value == pytest.approx(np.exp(states[-1].log_stiffness), rel=0.07)
    assert found.low < np.exp(states[-1].log_stiffness) < found.high


def test_single_reading_bounds_size_and_stiffness() -> None:
    width_mm, force_n = np.array([41.0, 40.0]), np.array([0.0, 2.0])
    assert close(width_mm, force_n, measure=measure_soft_stiffness) is None
    found = close(width_mm, force_n)
    # Fingers that deflect by 0.55 mm at 2 N leave at most 0.45 mm for the object.
    assert 40.55 - 0.15 < found.size_mm.low < found.size_mm.high < 41.3
    assert found.stiffness.low < 2.0 / 0.45 < 0.1 * found.stiffness.high


@pytest.mark.parametrize("n_per_mm", [0.6, 2.0])
def test_weak_reading_of_a_firm_contact_does_not_move_the_size(n_per_mm: float) -> None:
    """Near its threshold, a sheet reads half of the force of a hand that has met the object."""
    force_n = np.array([0.85, 1.25, 1.4, 1.6, 1.8])
    width_mm = 40.0 - force_n / n_per_mm - HAND.deflection_mm(force_n)
    read_n = np.array([0.43, 1.25, 1.4, 1.6, 1.8])
    found = close(width_mm, read_n, floor_n=0.28, law_sd=0.1)
    assert found.size_mm.low < 40.0 < found.size_mm.high
    assert found.stiffness.low < n_per_mm < found.stiffness.high


# -- fingers that deflect more than the object -----------------------------------------------------


def soft_stiffness(stiffness: float, *, gain: float = 1.0, half: float = 0.1) -> Measurement:
    """Close on a 40 mm object, with all forces scaled by the gain."""
    force = np.array([0.0, 0.6, 2.0, 4.0, 6.0])
    width = 40.0 - (3.5 + 1.0 / stiffness) * force
    width[0] = 40.5
    sds = {"gain_sd": 0.1, "law_sd": 0.1, "floor_n": 0.05, "weak_n": 0.1}
    how = {"measure": measure_soft_stiffness, "compliance": SOFT, "half": half}
    return close(width, gain * force, **how, **sds)


@pytest.mark.parametrize("stiffness", [0.1, 0.3, 0.6])
def test_soft_stiffness_measures_object_as_soft_as_fingers(stiffness: float) -> None:
    found = soft_stiffness(stiffness)
    assert found.low < stiffness < found.high < 6 * found.low
    assert found.value == pytest.approx(stiffness, rel=0.35)
    assert found.status is Status.OK


def test_soft_stiffness_of_stiff_object_has_only_lower_bound() -> None:
    found = soft_stiffness(20.0)
    assert (found.high, found.status) == (STIFFEST_N_PER_MM, Status.SATURATED)
    assert 0.8 < found.low < 20.0


@pytest.mark.parametrize("stiffness", [0.3, 1.0, 3.0, 100.0])
def test_soft_stiffness_interval_covers_sheet_errors(stiffness: float) -> None:
    """The scatter is from few placements, so the normalised error is Student's t."""
    gains = np.exp(0.1 * student_t.ppf((np.arange(100) + 0.5) / 100, 6))
    found = [soft_stiffness(stiffness, gain=float(gain), half=0.165) for gain in gains]
    assert 0.87 < np.mean([one.low <= stiffness <= one.high for one in found]) < 0.95


# -- compliance ------------------------------------------------------------------------------------


def test_compliance_fit_separates_pads_and_zero() -> None:
    force = np.linspace(0.2, 15, 25)
    true = 0.22 * force + 0.3 * -np.expm1(-force / 2.3)
    compliance = Compliance.fit(force, width_mm=40.0 - true - 0.1, block_mm=40.0)
    np.testing.assert_allclose(compliance.deflection_mm(force), true, atol=0.03)
    assert compliance.zero_mm == pytest.approx(-0.1, abs=0.03)
    assert 1 / compliance.stiffest_n_per_mm == pytest.approx(0.22, rel=0.03)


@pytest.mark.parametrize(
    "width", [[40.0, 40.0, 40.0, 40.0], [38.0, 38.5, 39.0, 40.0], [40.0, 39.0]]
)
def test_compliance_fit_refuses_non_rigid_block(width: list[float]) -> None:
    with pytest.raises(CalibrationError, match="is the block rigid"):
        Compliance.fit(np.arange(1.0, len(width) + 1), width_mm=width, block_mm=40.0)


def test_soft_finger_compliance_fit_refuses_blocks_of_one_size() -> None:
    force_n = np.linspace(0.5, 6.0, 8)
    with pytest.raises(CalibrationError, match="two sizes"):
        SoftFingerCompliance.fit(24.0 + 2.6 * force_n, force_n=force_n, block_mm=np.full(8, 40.0))
    sizes = np.repeat([40.0, 50.0], 4)
    with pytest.raises(CalibrationError, match="higher pressure"):
        SoftFingerCompliance.fit(sizes + force_n, force_n=force_n, block_mm=sizes)
