"""Gripper models: valid in MuJoCo, with the stated geometry."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from palpate.twin.objects import draw_object
from palpate_mujoco import MujocoWorld
from palpate_mujoco.hand import HANDS, SO101, find_hand


def posed(angle_rad: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the SO-101-like hand with its jaw at an angle."""
    model = SO101.spec().compile()
    data = mujoco.MjData(model)
    data.joint("jaw").qpos = angle_rad
    mujoco.mj_forward(model, data)
    return model, data


def pad_distance_mm(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the distance between the pads."""
    pads = [model.geom(pad.geom).id for pad in SO101.pads]
    return 1e3 * float(mujoco.mj_geomDistance(model, data, *pads, 1.0, np.zeros(6)))


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


@pytest.mark.parametrize("name", HANDS)
def test_empty_hand_reaches_target_width(name: str) -> None:
    world = MujocoWorld(None, seed=1, hand=find_hand(name))
    for width_mm in (20.0, 60.0):
        world.drive(width_mm, rate=40.0)
        world.clock.sleep_s(3.0)
        assert world.drive_value(world.now_s()) == pytest.approx(width_mm, abs=0.1)


def test_pads_touch_at_angle_zero_and_are_parallel_at_38_mm() -> None:
    assert pad_distance_mm(*posed(0.0)) == pytest.approx(0.0, abs=0.05)
    model, data = posed(0.533)
    assert pad_distance_mm(model, data) == pytest.approx(38.0, abs=0.05)
    fixed, moving = (data.geom(pad.geom).xmat.reshape(3, 3) for pad in SO101.pads)
    assert moving == pytest.approx(fixed, abs=1e-6)


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
