"""Every cycle worked through: rest values, pauses, wear."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_studies.fatigue_cycles import Wearing


@pytest.fixture(scope="module")
def worn() -> Wearing:
    """One sensor through a few cycles, with a pause after the fourth."""
    return Wearing(0, level="lab", cycles=8, checked_at=(4,))


def test_in_the_rhythm_the_rest_of_the_calibration_stays(worn: Wearing) -> None:
    """10 s after a load this sheet still forgets it."""
    assert worn.rezeroed == 0
    assert np.array_equal(worn.force_n[0], worn.force_n[1])


def test_after_a_pause_rest_values_are_taken(worn: Wearing) -> None:
    assert worn.rezeroed_in_pauses == 1
    assert np.array_equal(worn.force_n[2, :4], worn.force_n[0, :4])
    assert (worn.force_n[2, 4:] != worn.force_n[0, 4:]).all()


def test_wear_is_corrected_from_the_check_on(worn: Wearing) -> None:
    assert np.array_equal(worn.force_n[3, :4], worn.force_n[2, :4])
    shift = worn.force_n[3, 4:] / worn.force_n[2, 4:]
    assert (shift != 1).all()
    assert np.ptp(shift) < 0.02


def test_every_cycle_is_a_grasp_of_the_same_object(worn: Wearing) -> None:
    assert np.ptp(worn.true_n) < 0.05 * worn.true_n.mean()
    assert (np.abs(worn.force_n / worn.true_n - 1) < 0.3).all()
