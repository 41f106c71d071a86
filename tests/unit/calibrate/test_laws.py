"""Force pairs are chosen by when they were read."""

from __future__ import annotations

import pytest

from palpate.calibrate.laws import laws_of, pairs_at
from palpate.errors import CalibrationError
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import ForcePairs

PAIRS = ForcePairs(
    run=(0, 0, 0),
    since_move_s=(0.42, 20.0, 20.0),
    excess=(1.0, 2.0, 3.0),
    relative_percent=(-10.0, -20.0, -30.0),
    force_n=(0.5, 1.0, 1.5),
)


def test_only_pairs_of_that_time_are_taken() -> None:
    excess, force_n = pairs_at(PAIRS, since_move_s=20.0)
    assert excess.tolist() == [2.0, 3.0]
    assert force_n.tolist() == [1.0, 1.5]


def test_a_calibration_read_at_other_times_says_which() -> None:
    with pytest.raises(CalibrationError, match=r"no pairs read 0\.7 s .*0\.42, 20 s"):
        pairs_at(PAIRS, since_move_s=0.7)


def test_a_calibration_without_forces_says_how_to_get_them() -> None:
    none = ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=())
    with pytest.raises(CalibrationError, match=r"rest values only.*palpate calibrate force"):
        pairs_at(none, since_move_s=0.7)


def test_laws_of_a_sheet_that_takes_many_iterations_are_fitted() -> None:
    """SciPy's default number of iterations ends without weights on this sheet."""
    calibration = calibrate_twin(seed=1477554, level="field", apart_from="")
    assert calibration.force is not None
    assert laws_of(calibration.force).settled.residual_sd < 0.5
