"""The sorting study on synthetic crates."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packages.station.tests.factories import make_grasp

from palpate.measurement import Measurement
from palpate_station.sorting.hand import TimedGrasp
from palpate_studies.crates import CrateItemGrasps, write_crates

pytestmark = pytest.mark.slow

#: Size, mm, and stiffness, N/mm, of the trained kinds and of an untrained kind.
TAUGHT = {"egg": (44.0, 12.0), "kiwi": (50.0, 1.5), "lime": (45.0, 3.5), "apple": (63.0, 6.0)}
STRANGER = {"grape": (18.0, 1.0)}


def grasp(item_id: str, size_mm: float, stiffness: float, *, sensor: int) -> TimedGrasp:
    def measured(value: float, factor: float, unit: str) -> Measurement:
        return Measurement(value=value, low=value / factor, high=value * factor, unit=unit)

    found = {
        "size_mm": measured(size_mm, 1.01, "mm"),
        "stiffness_n_per_mm": measured(stiffness, 1.6, "n_per_mm"),
        "force_n": measured(2.5, 1.3, "n"),
        "settled_percent": Measurement(value=-20.0, low=-22.0, high=-18.0, unit="percent"),
    }
    one = make_grasp(item_id, calibration_id=f"twin-{sensor}", measurements=found)
    return TimedGrasp(grasp=one, lasted_s=12.0)


def synthetic_crates() -> list[CrateItemGrasps]:
    """Return items of two sensors at lab and one at field, those to learn from grasped twice."""
    rng = np.random.default_rng(5)
    found = []
    crates = (("lab", 0), ("lab", 1), ("field", 0))
    for (level, sensor), teaches in product(crates, (True, False)):
        for kind, (size, stiffness) in (TAUGHT if teaches else {**TAUGHT, **STRANGER}).items():
            for number in range(6 if teaches else 3):
                name = f"{'taught' if teaches else 'item'}-{kind}-{number}"
                true_mm = size * float(np.exp(0.04 * rng.standard_normal()))
                true_k = stiffness * float(np.exp(0.15 * rng.standard_normal()))
                read_k = true_k * np.exp(0.1 * rng.standard_normal(2 if teaches else 3))
                grasps = tuple(grasp(name, true_mm, float(k), sensor=sensor) for k in read_k)
                item = {"item_id": name, "kind": kind, "known": kind in TAUGHT, "size_mm": true_mm}
                place = {"level": level, "sensor": sensor, "teaches": teaches, "damaged": False}
                found.append(CrateItemGrasps(**place, **item, grasps=grasps))
    return found


def select_row(summary: list[dict[str, Any]], level: str, method: str) -> dict[str, Any]:
    return next(row for row in summary if (row["level"], row["method"]) == (level, method))


def test_sorting_study_names_and_sorts_the_items_of_a_crates_file(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    write_crates(synthetic_crates(), tmp_path / "in.json")
    found = document("sorting", "--crates", tmp_path / "in.json", "--out", tmp_path / "out")
    assert found["simulated"] is True
    assert (tmp_path / "out" / "crates.json").read_text() == (tmp_path / "in.json").read_text()
    ours = select_row(found["identify"], "lab", "ours, 3 grasps")
    assert ours["right"] > 0.9
    assert ours["falsely_unknown"] <= 0.2
    assert ours["strangers_found"] == 1.0
    assert ours["items"] == 24
    assert select_row(found["identify"], "lab", "ours, taught on other sensors")["right"] > 0.7
    bands = [row for row in found["reliability"] if row["level"] == "lab"]
    # Each of 30 items has a claim of each of 11 rules.
    assert sum(row["claims"] for row in bands) == 330
    assert all(row["from"] <= row["claimed"] <= row["to"] for row in bands)
    assert bands[0]["true"] < 0.1
    assert bands[-1]["true"] > 0.9
    one, three = (
        select_row(found["summary"], "lab", method)
        for method in ("ours, one grasp", "ours, up to 3 grasps")
    )
    assert three["purity"] > 0.9
    assert three["left_over"] < one["left_over"]
    assert three["items_per_hour"] < one["items_per_hour"] == pytest.approx(3600 / 16)
