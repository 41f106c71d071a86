"""Compliance of the gripper from closings on a block."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.compliance import Compliance


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
    force = np.arange(1.0, len(width) + 1)
    with pytest.raises(CalibrationError, match="is the block rigid"):
        Compliance.fit(force, width_mm=width, block_mm=40.0)
