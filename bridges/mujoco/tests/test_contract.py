"""The hand does what every gripper does: the product's own suite, on MuJoCo."""

from __future__ import annotations

import pytest
from tests.contract.hands import Hand
from tests.contract.test_grippers import (
    test_closing_lets_go_of_the_port_and_not_of_the_object,
    test_commands_are_clamped_and_returned_as_sent,
    test_it_goes_where_it_was_sent_and_says_so,
    test_it_is_no_faster_than_it_says,
    test_limits_make_sense,
    test_release_opens_fully,
    test_state_tells_its_own_quantity_alone,
    test_stop_never_closes_further,
)

from palpate.twin.devices import TwinGripper
from palpate_mujoco import MujocoWorld

__all__ = [
    "test_closing_lets_go_of_the_port_and_not_of_the_object",
    "test_commands_are_clamped_and_returned_as_sent",
    "test_it_goes_where_it_was_sent_and_says_so",
    "test_it_is_no_faster_than_it_says",
    "test_limits_make_sense",
    "test_release_opens_fully",
    "test_state_tells_its_own_quantity_alone",
    "test_stop_never_closes_further",
]


@pytest.fixture
def hand() -> Hand:
    world = MujocoWorld(None, seed=1)
    return Hand(
        gripper=TwinGripper(world),
        clock=world.clock,
        wait=world.clock.sleep_s,
        where=lambda: world.drive_value(world.now_s()),
    )
