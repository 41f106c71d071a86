"""The gripper contract tests of palpate, run on the MuJoCo hand."""

from __future__ import annotations

import pytest
from tests.contract.hands import Hand
from tests.contract.test_grippers import (
    test_gripper_close_keeps_the_position_or_vents,
    test_gripper_command_is_clamped_and_returned_as_sent,
    test_gripper_does_not_exceed_the_commanded_rate,
    test_gripper_limits_are_ordered_and_positive,
    test_gripper_reaches_the_commanded_target_and_reports_it,
    test_gripper_release_opens_fully,
    test_gripper_state_reports_only_its_controlled_quantity,
    test_gripper_stop_does_not_close_further,
)

from palpate.twin.devices import TwinGripper
from palpate_mujoco import MujocoWorld

__all__ = [
    "test_gripper_close_keeps_the_position_or_vents",
    "test_gripper_command_is_clamped_and_returned_as_sent",
    "test_gripper_does_not_exceed_the_commanded_rate",
    "test_gripper_limits_are_ordered_and_positive",
    "test_gripper_reaches_the_commanded_target_and_reports_it",
    "test_gripper_release_opens_fully",
    "test_gripper_state_reports_only_its_controlled_quantity",
    "test_gripper_stop_does_not_close_further",
]


@pytest.fixture
def hand() -> Hand:
    world = MujocoWorld(None, seed=1)
    return Hand(
        gripper=TwinGripper(world),
        clock=world.clock,
        wait=world.clock.sleep_s,
        read_position=lambda: world.drive_value(world.now_s()),
    )
