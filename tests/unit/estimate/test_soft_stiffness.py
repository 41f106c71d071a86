"""Stiffness from fingers that deflect more than the object."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student_t

from palpate.estimate.closing_curve import ClosingSteps
from palpate.estimate.compliance import STIFFEST_N_PER_MM, Compliance
from palpate.estimate.soft_stiffness import measure_soft_stiffness
from palpate.measurement import Measurement, Status

COMPLIANCE = Compliance(
    slope_mm_per_n=3.5, pad_mm=(0.0,) * 5, zero_mm=0.0, residual_mm=0.1, largest_force_n=15.0
)
FORCE_N = np.array([0.0, 0.6, 2.0, 4.0, 6.0])


def grasped(
    stiffness: float, *, gain: float = 1.0, half: float = 0.1, gain_sd: float = 0.1
) -> Measurement:
    """Close on a 40 mm object, with all forces scaled by the gain."""
    width_mm = 40.0 - (3.5 + 1.0 / stiffness) * FORCE_N
    width_mm[0] = 40.5
    curve = ClosingSteps(
        width_mm=width_mm, force_n=gain * FORCE_N, gain_sd=gain_sd, law_sd=0.1, floor_n=0.05
    )
    read_n = gain * float(FORCE_N[-1])
    held = Measurement(
        value=read_n, low=read_n * (1 - half), high=read_n * (1 + half), unit="n", level=0.9
    )
    found = measure_soft_stiffness(
        curve, compliance=COMPLIANCE, opening_mm=float(width_mm[-1]), force=held
    )
    assert found is not None
    return found


@pytest.mark.parametrize("stiffness", [0.1, 0.3, 0.6])
def test_soft_stiffness_measures_object_as_soft_as_fingers(stiffness: float) -> None:
    found = grasped(stiffness)
    assert found.low < stiffness < found.high
    assert found.high / found.low < 6
    assert found.value == pytest.approx(stiffness, rel=0.35)
    assert found.status is Status.OK


def test_soft_stiffness_of_stiff_object_has_only_lower_bound() -> None:
    found = grasped(20.0)
    assert found.high == STIFFEST_N_PER_MM
    assert found.status is Status.SATURATED
    assert 0.8 < found.low < 20.0


@pytest.mark.parametrize("stiffness", [0.3, 1.0, 3.0, 100.0])
def test_soft_stiffness_interval_covers_sheet_errors(stiffness: float) -> None:
    """The scatter is from few placements, so the normalised error is Student's t."""
    errors = 0.1 * student_t.ppf((np.arange(100) + 0.5) / 100, 6)
    held = [
        found.low <= stiffness <= found.high
        for error in errors
        for found in [grasped(stiffness, gain=float(np.exp(error)), half=0.165)]
    ]
    assert 0.87 < np.mean(held) < 0.95


def test_soft_stiffness_is_independent_of_common_gain() -> None:
    """The measured compliance of gripper and object is proportional to the gain."""
    plain, more = (3.5 + 1 / grasped(0.1, gain=gain, half=0.02).value for gain in (1.0, 1.3))
    assert 1.3 * more == pytest.approx(plain, rel=0.02)


def test_soft_stiffness_contact_at_last_step_returns_none() -> None:
    curve = ClosingSteps(
        width_mm=np.array([40.5, 40.0]),
        force_n=np.array([0.0, 1.0]),
        gain_sd=0.1,
        law_sd=0.1,
        floor_n=0.05,
    )
    held = Measurement(value=1.0, low=0.9, high=1.1, unit="n", level=0.9)
    assert measure_soft_stiffness(curve, compliance=COMPLIANCE, opening_mm=40.0, force=held) is None
