"""Selection of force pairs by their reading time, and force laws."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.calibration import ForcePairs
from palpate.errors import CalibrationError
from palpate.force.of_calibration import pairs_at

PAIRS = ForcePairs(
    run=(0, 0, 0),
    since_move_s=(0.42, 20.0, 20.0),
    excess=(1.0, 2.0, 3.0),
    relative_percent=(-10.0, -20.0, -30.0),
    force_n=(0.5, 1.0, 1.5),
)


@pytest.mark.parametrize(
    ("since_move_s", "message"),
    [
        (PAIRS.since_move_s, r"no pairs read 0\.7 s .*0\.42, 20 s"),
        ((20.0,) * 3, r"needs those of each.*again"),
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
