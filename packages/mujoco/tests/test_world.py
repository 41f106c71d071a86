"""A grasp in MuJoCo: forces balance, and results depend only on the seed."""

from __future__ import annotations

import numpy as np
import pytest
from packages.mujoco.tests.lying import contact_n

from palpate.twin.devices import TwinArray
from palpate.twin.mechanics import object_force_n
from palpate.twin.objects import TwinObject, draw_object
from palpate_mujoco import MujocoWorld

#: Bending stiffness of each finger (`hands/widowx.xml`).
FINGER_N_PER_MM = 10.0


def draw_subject(name: str) -> TwinObject:
    return draw_object(np.random.default_rng(1), name)


def squeezed(name: str, *, by_mm: float = 3.0, wait_s: float = 3.0) -> MujocoWorld:
    """Return a world with the fingers closed on an object."""
    obj = draw_subject(name)
    world = MujocoWorld(obj, seed=1)
    world.drive(obj.size_mm - by_mm, rate=20.0)
    world.clock.sleep_s(wait_s)
    return world


@pytest.mark.parametrize("name", ["springs-4", "springs-8"])
def test_object_fingers_and_pads_have_equal_forces(name: str) -> None:
    world = squeezed(name)
    force_n = world.force_n(world.now_s())
    flattened_mm = 1e3 * world.data.joint("object_flattened").qpos[0]
    bent_mm = 1e3 * world.data.joint("right_bend").qpos[0]
    law_n, _ = object_force_n(draw_subject(name), flattened_mm, ruptured=False)
    assert 2.0 * force_n == pytest.approx(contact_n(world.sensor), rel=1e-6)
    assert force_n == pytest.approx(FINGER_N_PER_MM * bent_mm, rel=0.01)
    # Springs relax by 0.3 % at most.
    assert force_n == pytest.approx(law_n, rel=0.01)


def test_first_finger_pushes_light_object_to_middle() -> None:
    world = squeezed("ball-44lbs")
    left_n, right_n = world.sensor.finger_n
    assert left_n == pytest.approx(right_n, abs=0.6)
    middle_mm = 1e3 * (world.data.geom("left_pad").xpos + world.data.geom("right_pad").xpos)[0]
    assert abs(middle_mm) < 1.0


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("springs-4", [[315, 255], [270, 301], [286, 280], [289, 274]]),
        ("strawberry", [[264, 230], [202, 239], [231, 251], [207, 223]]),
    ],
)
def test_frames_equal_stored_counts(name: str, counts: list[list[int]]) -> None:
    """Faster evaluation of contacts must not change the counts; a new contact law does."""
    obj = draw_subject(name)
    world = MujocoWorld(obj, seed=1)
    array = TwinArray(world)
    world.drive(obj.size_mm - 2.0, rate=20.0)
    frames = [array.read(timeout_s=1.0) for _ in range(60)]
    assert frames[-1].counts.tolist() == counts


def test_place_requires_open_fingers_and_changes_position() -> None:
    world = squeezed("ball-44lbs")
    with pytest.raises(ValueError, match="open them first"):
        world.place(draw_subject("ball-44lbs"))
    before = world.model.body("object").pos.copy()
    world.drive(74.0, rate=40.0)
    world.clock.sleep_s(3.0)
    world.place(draw_subject("ball-44lbs"))
    assert world.force_n(world.now_s()) == 0.0
    assert world.drive_value(world.now_s()) == pytest.approx(74.0, abs=0.05)
    # Between contacts at one placement the position changes by a third of a millimetre.
    assert np.abs(world.model.body("object").pos - before).max() > 1.5e-3
