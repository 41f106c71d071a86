"""Timed grasps of an item with a simulated hand."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.twin.crate import CrateTable, draw_crate
from palpate.twin.rig import calibrate_twin
from palpate_station.sorting.hand import SortingHand

NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)


@pytest.fixture(scope="module")
def table() -> CrateTable:
    return CrateTable(sensor=7, seed=8)


@pytest.fixture(scope="module")
def hand(table: CrateTable) -> SortingHand:
    calibration = calibrate_twin(seed=7, level="lab", apart_from="")
    return SortingHand(
        array=table.array,
        gripper=table.gripper,
        clock=table.clock,
        plan=plan_grasp(calibration, gripper=table.gripper),
        rig="sim-rigid",
        origin="twin",
        calibration_id="monday",
        now=lambda: NOON,
    )


@pytest.mark.slow
def test_sorting_hand_measures_item_and_accepts_expected_size(
    table: CrateTable, hand: SortingHand
) -> None:
    egg = draw_crate(["egg"], seed=5)[0]
    table.place(egg)
    first = hand.grasp("egg-1")
    assert first.grasp.outcome is Outcome.HELD
    names = {"settled_percent", "size_mm", "force_n", "stiffness_n_per_mm", "firmness"}
    assert set(first.grasp.measurements) == names
    assert (first.grasp.item_id, first.grasp.calibration_id) == ("egg-1", "monday")
    assert (first.grasp.taken_at, first.grasp.is_simulated) == (NOON, True)
    table.place(egg, turn=1)
    second = hand.grasp("egg-1", expected=first.grasp.measurements["size_mm"])
    assert second.grasp.outcome is Outcome.HELD
    assert second.grasp.measurements["size_mm"].value == pytest.approx(egg.mean.size_mm, abs=3)
    assert not table.is_damaged()
