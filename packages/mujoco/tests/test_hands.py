"""Gripper models: valid in MuJoCo, with the stated geometry."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.twin.objects import draw_object
from palpate_mujoco import MujocoWorld
from palpate_mujoco.hand import HANDS, SO101, find_hand


@pytest.mark.parametrize("name", HANDS)
def test_squeeze_causes_no_mujoco_warnings(name: str) -> None:
    obj = draw_object(np.random.default_rng(1), "springs-8")
    world = MujocoWorld(obj, seed=1, hand=find_hand(name))
    world.drive(36.0, rate=20.0)
    world.clock.sleep_s(4.0)
    assert world.force_n(world.now_s()) > 10.0
    world.drive(74.0, rate=60.0)
    world.clock.sleep_s(2.0)
    assert world.force_n(world.now_s()) == 0.0
    assert [warning.number for warning in world.data.warning] == [0] * len(world.data.warning)


def test_moving_jaw_pushes_object_to_fixed_jaw() -> None:
    obj = draw_object(np.random.default_rng(1), "ball-44lbs")
    world = MujocoWorld(obj, seed=1, hand=SO101)
    # The chord read by the servo is about 5 mm less than the gap; a calibration corrects this.
    world.drive(obj.size_mm - 8.0, rate=20.0)
    world.clock.sleep_s(3.0)
    assert world.force_n(world.now_s()) > 1.0
    fixed_n, moving_n = world.sensor.finger_n
    assert moving_n == pytest.approx(fixed_n, abs=0.6)
    bent_m = 1e-4 * fixed_n
    place_m = world.data.geom("fixed_pad").xpos
    assert place_m == pytest.approx([-0.020 - bent_m, 0.0, 0.0], abs=2e-5)
