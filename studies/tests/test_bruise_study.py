"""The study of bruised apples, made small."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.produce.bruise import model as bruise_model
from palpate.produce.bruise.model import REFERENCES, load_simulated_sides
from palpate_studies import bruise
from palpate_studies.bruise import (
    SAME_WIDTH,
    TOGETHER,
    Examined,
    ScoredSides,
    area,
    area_lost,
    examine,
    save_sides,
    way,
)
from palpate_studies.fruit_ranges import BRUISES

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def examined() -> list[Examined]:
    """Return a few apples of each purpose; `field` reuses those of `paper`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bruise, "REFERENCE_APPLES", 1)
        purposes = {"learn": 20, "test": 4}
        made = examine(purposes, levels=("lab",), seed=900)
    return made + [replace(one, level="field") for one in made]


def test_sides_are_placed_and_grasped_as_said(examined: list[Examined]) -> None:
    learned = [one for one in examined if one.purpose == "learn"]
    assert sum(one.is_bruised for one in learned) == 20
    for one in learned:
        assert set(one.presses) == {"before", "now", "other"}
        assert all(np.isfinite(press.settled_percent).all() for press in one.presses.values())
        if one.apple.bruise is not None:
            assert abs(one.apple.bruise.height_mm) <= 6.0
            low, high = BRUISES.diameter_mm_log
            assert low <= one.apple.bruise.diameter_mm <= high


def test_an_early_answer_sees_nothing_later(examined: list[Examined]) -> None:
    press = examined[0].presses["now"]
    late = (press.time_s > 1.0)[:, None, None]
    changed = replace(
        press,
        change_percent=press.change_percent + 10.0 * late,
        settled_percent=press.settled_percent + 10.0,
    )
    assert np.array_equal(changed.shape(1.0).modes, press.shape(1.0).modes)
    assert not np.array_equal(changed.shape(2.5).modes, press.shape(2.5).modes)
    assert not np.array_equal(changed.shape(20.0).modes, press.shape(20.0).modes)


def test_the_report_holds_every_way_and_writes_its_sides(
    examined: list[Examined], tmp_path: Path
) -> None:
    found = bruise.judge(examined)
    document = json.loads(json.dumps(found.payload, allow_nan=False))
    for level in ("lab", "field"):
        ways = document["ways"][level]
        assert {SAME_WIDTH, TOGETHER, way("ours", "history"), way("boosted trees", "item")} < set(
            ways
        )
        assert len(ways) == 11
        assert all(0 <= one["auc"] <= 1 for one in ways.values())
        assert document["apples"][level]["learn"] == 20
        assert sum(row["level"] == level for row in document["compared"]) == 12
    found.write(tmp_path)
    for level in ("lab", "field"):
        written = json.loads((tmp_path / f"bruise-sides-{level}.json").read_text())
        assert level in written["learned_on"]
        assert set(written["sides"]) == {"history", "class", "item"}


def test_the_area_counts_ties_as_halves() -> None:
    assert area(np.array([True, False]), np.array([1.0, 1.0])) == 0.5
    assert np.isnan(area(np.array([True, True]), np.array([1.0, 2.0])))


def test_an_area_is_compared_on_the_same_drawn_sensors() -> None:
    truth, sensors = np.array([True, False] * 20), [str(place // 4) for place in range(40)]
    noise = np.random.default_rng(1).standard_normal((2, 40))
    good, poor = (
        ScoredSides(bruised=truth, score=shift * truth + one, sensors=sensors)
        for shift, one in zip((4.0, 0.5), noise, strict=True)
    )
    found = area_lost(good, poor)
    assert found.value == pytest.approx(poor.auc - good.auc)
    assert (found.verdict, found.cases, found.specimens) == ("ours", 40, 10)
    assert area_lost(good, good).verdict == "undecided"


def test_simulated_sides_survive_their_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learned_on, known = load_simulated_sides()
    save_sides(known, learned_on, tmp_path / "sides.json")
    monkeypatch.setattr(bruise_model, "_SIMULATED", tmp_path / "sides.json")
    again = load_simulated_sides()[1]
    assert all(np.array_equal(again[name].rows, known[name].rows) for name in REFERENCES)
    assert all(again[name].labels == known[name].labels for name in REFERENCES)
