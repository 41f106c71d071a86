"""The gripper contract tests of palpate, run on the MuJoCo hand."""

from __future__ import annotations

import pytest
from tests.contract.hands import Hand
from tests.contract.test_grippers import *  # noqa: F403 - all of the contract

from palpate.twin.devices import TwinGripper
from palpate_mujoco import MujocoWorld


@pytest.fixture
def hand() -> Hand:
    world = MujocoWorld(None, seed=1)
    return Hand(
        gripper=TwinGripper(world),
        clock=world.clock,
        wait=world.clock.sleep_s,
        read_position=lambda: world.drive_value(world.now_s()),
    )
