"""Correction for climate, and wear: learned from a reference load, refused where it can't be."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate_studies.conditions import Conditions, ConditionsCorrection
from palpate_studies.wear import WearTrack

COOL, ROOM, WARM = (
    Conditions(temperature_c=t, humidity_percent=h)
    for t, h in ((15.0, 70.0), (22.0, 45.0), (27.0, 50.0))
)


def gain(at: Conditions) -> float:
    return float(np.exp(0.02 * (at.temperature_c - 22.0) - 0.004 * (at.humidity_percent - 45.0)))


def test_three_conditions_give_the_plane() -> None:
    learned = ConditionsCorrection.fit(
        [5.0 * gain(c) for c in (ROOM, COOL, WARM)], conditions=[ROOM, COOL, WARM]
    )
    other = Conditions(temperature_c=20.0, humidity_percent=60.0)
    assert learned.corrected(3.0 * gain(other), at=other).item() == pytest.approx(3.0)


def test_two_conditions_hold_on_the_line_between_them() -> None:
    ends = [ROOM, WARM]
    learned = ConditionsCorrection.fit([5.0 * gain(c) for c in ends], conditions=ends)
    middle = Conditions(temperature_c=24.5, humidity_percent=47.5)
    assert learned.corrected(3.0 * gain(middle), at=middle).item() == pytest.approx(3.0)
    assert learned.reaches(middle)
    assert not learned.reaches(COOL)


def test_relative_change_is_corrected_through_the_conductance() -> None:
    learned = ConditionsCorrection.fit(
        [5.0 * gain(c) for c in (ROOM, COOL)], conditions=[ROOM, COOL]
    )
    excess = 2.0 * gain(COOL)
    read = 100 * (1 / (1 + excess) - 1)
    assert learned.corrected_percent(read, at=COOL).item() == pytest.approx(100 * (1 / 3 - 1))


@pytest.mark.parametrize(
    ("excess", "conditions", "says"),
    [([5.0, 5.1], [ROOM, ROOM], "one condition"), ([5.0, 0.0], [ROOM, WARM], "no load")],
)
def test_useless_calibrations_are_refused(
    excess: list[float], conditions: list[Conditions], says: str
) -> None:
    with pytest.raises(CalibrationError, match=says):
        ConditionsCorrection.fit(excess, conditions=conditions)


def test_wear_between_checks_goes_with_the_log_of_use() -> None:
    track = WearTrack.started(cycles=0, excess=10.0).checked(cycles=99, excess=8.0)
    assert track.corrected(8.0, cycles=99) == pytest.approx(10.0)
    assert track.corrected(np.sqrt(80.0), cycles=9) == pytest.approx(10.0)
    assert track.corrected(8.0, cycles=5000) == pytest.approx(10.0)


def test_wear_gives_advice_once_it_matters() -> None:
    started = WearTrack.started(cycles=0, excess=10.0)
    assert started.advice(cycles=10) == ""
    assert "since the last check" in started.advice(cycles=2000)
    assert "calibrate force" in started.checked(cycles=100, excess=8.5).advice(cycles=100)


@pytest.mark.parametrize(
    ("cycles", "excess", "says"), [(50, 0.0, "no load"), (5, 9.0, "must rise")]
)
def test_useless_wear_checks_are_refused(cycles: int, excess: float, says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        WearTrack.started(cycles=10, excess=10.0).checked(cycles=cycles, excess=excess)
