"""Selection of force pairs by their reading time, and force laws."""

from __future__ import annotations

from dataclasses import replace

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


def test_pairs_at_selects_pairs_of_the_given_time() -> None:
    excess, force_n = pairs_at(PAIRS, since_move_s=20.0)
    assert excess.tolist() == [2.0, 3.0]
    assert force_n.tolist() == [1.0, 1.5]


@pytest.mark.parametrize(
    ("since_move_s", "message"),
    [
        (PAIRS.since_move_s, r"no pairs read 0\.7 s .*0\.42, 20 s"),
        ((20.0,) * 3, r"dead weights.*load cell"),
        ((), r"rest values only.*palpate calibrate force"),
    ],
)
def test_pairs_at_error_names_times_load_cell_or_command(
    since_move_s: tuple[float, ...], message: str
) -> None:
    values = PAIRS.force_n[: len(since_move_s)]
    pairs = replace(
        PAIRS,
        run=PAIRS.run[: len(since_move_s)],
        since_move_s=since_move_s,
        excess=values,
        relative_percent=tuple(-value for value in values),
        force_n=values,
    )
    with pytest.raises(CalibrationError, match=message):
        pairs_at(pairs, since_move_s=0.7)


@pytest.mark.slow
def test_laws_of_sheet_needing_many_iterations_converge() -> None:
    """The default iteration limit of SciPy is too low for this sheet."""
    calibration = calibrate_twin(seed=1477554, level="field", apart_from="")
    assert calibration.force is not None
    assert laws_of(calibration.force).settled.residual_sd < 0.5
