"""The study of ripeness: a station on the twin, and scores of judgements."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import build_app, run
from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import Grasp
from palpate.produce.ripeness.firmness import firmness_of
from palpate.produce.ripeness.stages import STAGES
from palpate_studies import ripeness_station
from palpate_studies.baselines.ripeness_learners import STAGE_LEARNERS
from palpate_studies.ripeness import CONDITIONS, choose_conditions, judge
from palpate_studies.ripeness_scores import compare_methods, judge_days, scores
from palpate_studies.ripeness_station import DAYS, draw_labelled, run_station
from palpate_studies.station_records import StationRecords
from palpate_studies.twin_avocado import Avocado, draw_avocado

pytestmark = pytest.mark.slow

FIRST, FEW_GRASPS = datetime(2026, 5, 4, 8, tzinfo=UTC), 8


@pytest.fixture(scope="module")
def station() -> Iterator[StationRecords]:
    """Run a station with fewer grasps than the study, which takes minutes."""
    with pytest.MonkeyPatch.context() as few:
        few.setattr(ripeness_station, "LABELLED_GRASPS", FEW_GRASPS)
        yield run_station(41, level="lab", gripper="rigid", aging=True, labelled=0, others=1)


def test_station_grasps_fruit_every_day(station: StationRecords) -> None:
    fruit = [grasp for grasp in station.grasps if grasp.item_id == "fruit-0"]
    assert len(fruit) == FEW_GRASPS * DAYS
    assert all({"firmness", "width_mm"} <= set(grasp.measurements) for grasp in station.grasps)
    assert all(grasp.outcome is Outcome.HELD and grasp.is_simulated for grasp in station.grasps)
    assert all(grasp.pixel_settled_percent is not None for grasp in station.grasps)
    assert len({grasp.temperature_c for grasp in fruit}) == DAYS
    assert set(station.as_published) == {("fruit-0", day) for day in range(DAYS)}
    assert station.damaged == 0


def test_station_firmness_follows_the_softening_of_the_fruit(station: StationRecords) -> None:
    def means(item_id: str) -> list[float]:
        records = [
            (grasp.taken_at.date(), firmness)
            for grasp in station.grasps
            if grasp.item_id == item_id and (firmness := firmness_of(grasp)) is not None
        ]
        days = sorted({day for day, _ in records})
        return [float(np.mean([f for day, f in records if day == one])) for one in days]

    true = [math.log(station.others[0].force_at_1mm_n(day)) for day in range(DAYS)]
    assert np.corrcoef(true, means("fruit-0"))[0, 1] > 0.9


def synthetic_records(
    station: StationRecords, *, worn: float, labelled_fruits: int = 12
) -> StationRecords:
    """Return synthetic records of a station, with noise and drift."""
    rng = np.random.default_rng(8)
    labelled, others = (tuple(draw_avocado(rng) for _ in range(n)) for n in (labelled_fruits, 10))
    grasps: list[Grasp] = []

    def add_grasp(item_id: str, stiffness: float, when: float) -> None:
        drift = worn * min(when / 10.0, 1.0) + 0.03 * rng.standard_normal()
        value = stiffness * math.exp(2.0 / 3.0 * drift)
        grasps.append(
            Grasp(
                item_id=item_id,
                taken_at=FIRST + timedelta(days=when),
                rig="made-up",
                drive="width",
                origin="twin",
                outcome=Outcome.HELD,
                measurements={
                    name: Measurement(value=one, low=0.9 * one, high=1.1 * one, unit=unit)
                    for name, one, unit in (
                        ("firmness", 100.0 * math.log10(value / 0.1) / 3.0, "index"),
                        ("stiffness_n_per_mm", value, "n_per_mm"),
                        ("force_n", 5.0, "n"),
                        ("width_mm", 60.0, "mm"),
                    )
                },
            )
        )

    def stiffness(fruit: Avocado, day: int) -> float:
        return 1.5 * math.pow(fruit.force_at_1mm_n(day), 2.0 / 3.0)

    for begins, fruits, name in ((0, labelled, "labelled"), (7, others, "fruit")):
        for day in range(DAYS):
            for _ in range(3):
                for number, fruit in enumerate(fruits):
                    add_grasp(f"{name}-{number}", stiffness(fruit, day), begins + day)
    published = {
        (f"{name}-{number}", day): -50.0 + 10 * rng.standard_normal()
        for name, fruits in (("labelled", labelled), ("fruit", others))
        for number in range(len(fruits))
        for day in range(DAYS)
    }
    return StationRecords(
        calibration=station.calibration,
        labelled=labelled,
        others=others,
        grasps=tuple(grasps),
        damaged=0,
        as_published=published,
    )


def test_scores_of_a_steady_sensor_favour_firmness_over_settled_change(
    station: StationRecords,
) -> None:
    found = scores(judge_days(synthetic_records(station, worn=0.0)))
    assert found["fruit_days"] == 10 * DAYS
    assert found["ours"]["exact"] > 0.85
    assert found["ours"]["within_one"] == 1.0
    assert found["settled change"]["exact"] < 0.6
    assert found["days_to_ripe"]["coverage"] > 0.7


def test_judge_days_trains_learners_on_all_stations(station: StationRecords) -> None:
    records, other = (synthetic_records(station, worn=0.0, labelled_fruits=n) for n in (6, 12))
    alone, shared = judge_days(records, name="a"), judge_days(records, others=[other], name="a")
    for learner in STAGE_LEARNERS:
        assert scores(alone)[learner]["exact"] > 0.5
        assert scores(shared)[learner]["exact"] > 0.75
    assert [row.stages["trees"] for row in alone] != [row.stages["trees"] for row in shared]
    assert [row.stages["ours"] for row in alone] == [row.stages["ours"] for row in shared]


def test_compare_methods_pairs_by_fruit(station: StationRecords) -> None:
    rows = judge_days(synthetic_records(station, worn=0.0), name="a")
    assert len({row.fruit for row in rows}) == 10
    never = [
        replace(row, stages=row.stages | {"settled change": row.stages["ours"]}) for row in rows
    ]
    always = [
        replace(row, stages=row.stages | {"settled change": (row.truth + 1) % 4, "ours": row.truth})
        for row in rows
    ]
    for judgements, difference in ((never, 0.0), (always, -1.0)):
        (row,) = (one for one in compare_methods(judgements) if one["rival"] == "settled change")
        assert (row["difference"], row["cases"], row["specimens"]) == (difference, 40, 10)


def test_draw_labelled_includes_every_stage() -> None:
    for seed in range(5):
        drawn = draw_labelled(np.random.default_rng(seed), 3)
        seen = [{one.stage(day) for one in drawn[:n] for day in range(DAYS)} for n in (-1, None)]
        assert seen[1] == set(STAGES)
        assert len(drawn) == 3 or len(seen[0]) < len(STAGES)
    assert draw_labelled(np.random.default_rng(0), 0) == ()


def test_ripeness_report_is_complete_and_states_simulated(
    station: StationRecords, tmp_path: Path
) -> None:
    records = synthetic_records(station, worn=-0.2, labelled_fruits=6)
    made = judge({("lab", "rigid", True): [records], ("lab", "rigid", False): [records]})
    made.write(tmp_path)
    document = json.loads((tmp_path / "ripeness.json").read_text())
    assert [one["aging"] for one in document["conditions"]] == [True, False]
    first = document["conditions"][0]
    assert first["fruit_days"] == 10 * DAYS
    assert first["grasps_a_day"] == 3
    text = (tmp_path / "ripeness.md").read_text()
    assert "Simulated throughout" in text


def test_choose_conditions_filters_by_each_option() -> None:
    assert tuple(choose_conditions()) == CONDITIONS
    assert choose_conditions(level="field") == [("field", "rigid", True), ("field", "soft", True)]
    assert choose_conditions(gripper="soft", aging=False) == [("lab", "soft", False)]
    assert choose_conditions(level="lab", gripper="rigid", aging=True) == [("lab", "rigid", True)]


def test_ripeness_command_without_matching_condition_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = ["study", "ripeness", "--level", "field", "--gripper", "soft", "--no-aging"]
    assert run(build_app(), asked, name="palpate") == 2
    assert "leave --no-aging out" in capsys.readouterr().err


def test_judge_without_unripe_fruit_raises(station: StationRecords) -> None:
    records = synthetic_records(station, worn=0.0, labelled_fruits=6)
    with pytest.raises(InputError, match="judge more fruits with --fruits"):
        judge({("lab", "rigid", True): [replace(records, others=())]})
