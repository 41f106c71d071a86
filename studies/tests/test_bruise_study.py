"""The study of bruised apples at small size."""

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
    compare_areas,
    examine,
    name_method,
    save_sides,
)
from palpate_studies.fruit_ranges import BRUISES

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def examined() -> list[Examined]:
    """Return a few apples of each purpose; `field` reuses the apples of `lab`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bruise, "REFERENCE_APPLES", 1)
        purposes = {"learn": 20, "test": 4}
        made = examine(purposes, levels=("lab",), seed=900)
    return made + [replace(one, level="field") for one in made]


def test_examine_places_and_grasps_each_side(examined: list[Examined]) -> None:
    learned = [one for one in examined if one.purpose == "learn"]
    assert sum(one.is_bruised for one in learned) == 20
    for one in learned:
        assert set(one.presses) == {"before", "now", "other"}
        assert all(np.isfinite(press.settled_percent).all() for press in one.presses.values())
        if one.apple.bruise is not None:
            assert abs(one.apple.bruise.height_mm) <= 6.0
            low, high = BRUISES.diameter_mm_log
            assert low <= one.apple.bruise.diameter_mm <= high


def test_load_shape_does_not_depend_on_later_frames(examined: list[Examined]) -> None:
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


def test_report_has_every_method_and_writes_training_sides(
    examined: list[Examined], tmp_path: Path
) -> None:
    found = bruise.judge(examined)
    document = json.loads(json.dumps(found.payload, allow_nan=False))
    for level in ("lab", "field"):
        summary = document["ways"][level]
        ours, trees = name_method("ours", "history"), name_method("boosted trees", "item")
        assert {SAME_WIDTH, TOGETHER, ours, trees} < set(summary)
        assert len(summary) == 11
        assert all(0 <= one["auc"] <= 1 for one in summary.values())
        assert document["apples"][level]["learn"] == 20
        assert sum(row["level"] == level for row in document["compared"]) == 12
    found.write(tmp_path)
    for level in ("lab", "field"):
        written = json.loads((tmp_path / f"bruise-sides-{level}.json").read_text())
        assert level in written["learned_on"]
        assert set(written["sides"]) == {"history", "class", "item"}


def test_area_counts_ties_half() -> None:
    assert area(np.array([True, False]), np.array([1.0, 1.0])) == 0.5
    assert np.isnan(area(np.array([True, True]), np.array([1.0, 2.0])))


def test_compare_areas_resamples_sensors() -> None:
    truth, sensors = np.array([True, False] * 20), [str(place // 4) for place in range(40)]
    noise = np.random.default_rng(1).standard_normal((2, 40))
    good, poor = (
        ScoredSides(bruised=truth, score=shift * truth + one, sensors=sensors)
        for shift, one in zip((4.0, 0.5), noise, strict=True)
    )
    found = compare_areas(good, poor)
    assert found.value == pytest.approx(poor.auc - good.auc)
    assert (found.verdict, found.cases, found.specimens) == ("ours", 40, 10)
    assert compare_areas(good, good).verdict == "undecided"


def test_sides_file_roundtrip_preserves_sides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learned_on, known = load_simulated_sides()
    save_sides(known, learned_on, tmp_path / "sides.json")
    monkeypatch.setattr(bruise_model, "_SIMULATED", tmp_path / "sides.json")
    again = load_simulated_sides()[1]
    assert all(np.array_equal(again[name].rows, known[name].rows) for name in REFERENCES)
    assert all(again[name].labels == known[name].labels for name in REFERENCES)
