"""Timed grasps of an item with a simulated hand."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from itertools import takewhile
from typing import Any

import pytest

from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.measurement import Measurement
from palpate.produce.sorting.hand import SortingHand
from palpate.rig.simulated import calibrate_twin
from palpate.twin.crate import CrateTable, draw_crate

NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)


class RecordingGripper:
    """A gripper that records its commands."""

    def __init__(self, gripper: Gripper) -> None:
        self._inner, self.sent = gripper, list[GripperCommand]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        self.sent.append(wanted)
        return self._inner.command(wanted)


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


def test_sorting_hand_with_known_size_approaches_fast_only_outside_the_clearance(
    table: CrateTable, hand: SortingHand
) -> None:
    with_size = RecordingGripper(table.gripper)
    table.place(draw_crate(["kiwi"], seed=6)[0])
    size = Measurement(value=40.0, low=39.5, high=40.5, unit="mm")
    replace(hand, gripper=with_size).grasp("kiwi-1", expected=size)
    without_size = RecordingGripper(table.gripper)
    replace(hand, gripper=without_size).grasp("kiwi-1")
    slow_rate = without_size.sent[1].rate
    # With a known size the approach is faster, but only outside the clearance.
    fast = list(takewhile(lambda command: command.rate > 1.3 * slow_rate, with_size.sent))
    assert len(fast) > 3
    assert all(command.target >= 40.5 * 1.15 + 4 for command in fast)
