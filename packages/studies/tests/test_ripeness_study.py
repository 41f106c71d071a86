"""The study of ripeness: a station on the twin, and scores of judgements."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from operator import itemgetter
from pathlib import Path

import numpy as np
import pytest
from packages.station.tests.factories import make_grasp

from palpate.errors import InputError
from palpate.measurement import Measurement
from palpate_station.records import Grasp
from palpate_studies import ripeness_station
from palpate_studies.ripeness import judge
from palpate_studies.ripeness_station import DAYS, run_station
from palpate_studies.station_records import StationRecords
from palpate_studies.twin_avocado import Avocado, draw_avocado

pytestmark = pytest.mark.slow

FIRST, FEW_GRASPS = datetime(2026, 5, 4, 8, tzinfo=UTC), 6


@pytest.fixture(scope="module")
def station() -> Iterator[StationRecords]:
    """Run a station with fewer grasps than the study, which takes minutes."""
    with pytest.MonkeyPatch.context() as few:
        few.setattr(ripeness_station, "LABELLED_GRASPS", FEW_GRASPS)
        yield run_station(41, level="lab", gripper="rigid", aging=True, labelled=0, others=1)


def synthetic_records(station: StationRecords) -> StationRecords:
    """Return synthetic records of a station, with noise."""
    rng = np.random.default_rng(8)
    labelled, others = (tuple(draw_avocado(rng) for _ in range(n)) for n in (8, 10))

    def make(item_id: str, fruit: Avocado, *, day: int, when: float) -> Grasp:
        stiffness = 1.5 * math.pow(fruit.force_at_1mm_n(day), 2.0 / 3.0)
        value = stiffness * math.exp(0.02 * rng.standard_normal())
        measured = {
            name: Measurement(value=one, low=0.9 * one, high=1.1 * one, unit=unit)
            for name, one, unit in (
                ("firmness", 100.0 * math.log10(value / 0.1) / 3.0, "index"),
                ("stiffness_n_per_mm", value, "n_per_mm"),
                ("force_n", 5.0, "n"),
                ("width_mm", 60.0, "mm"),
            )
        }
        return make_grasp(item_id, taken_at=FIRST + timedelta(days=when), measurements=measured)

    groups = (("labelled", 0, labelled), ("fruit", 7, others))
    named = [
        (f"{name}-{number}", fruit, day, begins + day)
        for name, begins, fruits in groups
        for day in range(DAYS)
        for number, fruit in enumerate(fruits)
    ]
    in_order = sorted(named * 3, key=itemgetter(3))
    return StationRecords(
        calibration=station.calibration,
        labelled=labelled,
        others=others,
        grasps=tuple(make(name, f, day=day, when=when) for name, f, day, when in in_order),
        damaged=0,
        as_published={(name, day): -50.0 + 10 * rng.standard_normal() for name, _, day, _ in named},
    )


def test_report_of_a_steady_sensor_favours_firmness_over_settled_change(
    station: StationRecords, tmp_path: Path
) -> None:
    records = synthetic_records(station)
    judge({("lab", "rigid", True): [records]}).write(tmp_path)
    document = json.loads((tmp_path / "ripeness.json").read_text())
    (found,) = document["conditions"]
    assert (found["aging"], found["fruit_days"], found["grasps_a_day"]) == (True, 10 * DAYS, 3)
    assert found["ours"]["exact"] > 0.85
    assert found["ours"]["within_one"] == 1.0
    assert found["settled change"]["exact"] < 0.6
    assert found["days_to_ripe"]["coverage"] > 0.7
    assert "Simulated throughout" in (tmp_path / "ripeness.md").read_text()
    with pytest.raises(InputError, match="judge more fruits with --fruits"):
        judge({("lab", "rigid", True): [replace(records, others=())]})


def test_ripeness_command_without_matching_condition_is_refused(
    refusal: Callable[..., str],
) -> None:
    asked = ["--level", "field", "--gripper", "soft", "--no-aging"]
    assert "leave --no-aging out" in refusal("ripeness", *asked)
