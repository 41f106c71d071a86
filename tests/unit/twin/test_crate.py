"""Simulated mixed crates: draws within ranges and within the range of the gripper."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.gripper.interface import GripperCommand
from palpate.twin.crate import (
    TRAINED_KINDS,
    UNTRAINED_KINDS,
    CrateTable,
    draw_crate,
)
from palpate.twin.world import OPEN_MM

ALL = {**TRAINED_KINDS, **UNTRAINED_KINDS}


def test_crate_item_sizes_are_within_kind_range_and_gripper_opening() -> None:
    for item in draw_crate([*ALL] * 10, seed=1):
        kind, ranges = item.kind, ALL[item.kind]
        assert ranges.size_mm[0] <= item.mean.size_mm <= ranges.size_mm[1]
        sides = [item.side(turn).size_mm / item.mean.size_mm for turn in range(5)]
        assert max(abs(np.array(sides) - 1)) <= ranges.out_of_round
        assert max(sides) * item.mean.size_mm < OPEN_MM - 3
        assert item.is_trained == (kind in TRAINED_KINDS)
        assert item.mean.yield_n <= item.mean.rupture_n


def test_crate_table_place_opens_gripper_and_drops_old_frames() -> None:
    table = CrateTable(sensor=1, seed=2)
    first, second = draw_crate(["egg", "apple"], seed=5)
    table.place(first)
    table.gripper.command(GripperCommand(target=50.0, rate=20.0))
    table.place(second, turn=3)
    assert table.gripper.state().width_mm == pytest.approx(OPEN_MM, abs=0.1)
    frame = table.array.read(timeout_s=1.0)
    assert table.clock.now_s() - frame.time_s < 0.1
    assert not table.is_damaged()
