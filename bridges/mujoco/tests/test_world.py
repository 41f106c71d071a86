"""A grasp in MuJoCo: the forces balance, and chance alone decides what differs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bridges.mujoco.tests.lying import contact_n

from palpate.twin.devices import TwinArray
from palpate.twin.mechanics import object_force_n
from palpate.twin.objects import TwinObject, draw_object
from palpate_mujoco import MujocoWorld

#: Of each finger's bend (`hands/widowx.xml`).
FINGER_N_PER_MM = 10.0


def thing(name: str) -> TwinObject:
    return draw_object(np.random.default_rng(1), name)


def squeezed(name: str, *, by_mm: float = 3.0, wait_s: float = 3.0) -> MujocoWorld:
    """Return a world in which the fingers have closed on an object."""
    obj = thing(name)
    world = MujocoWorld(obj, seed=1)
    world.drive(obj.size_mm - by_mm, rate=20.0)
    world.clock.sleep_s(wait_s)
    return world


@pytest.mark.parametrize("name", ["springs-4", "springs-8"])
def test_object_fingers_and_pads_carry_one_force(name: str) -> None:
    world = squeezed(name)
    force_n = world.force_n(world.now_s())
    flattened_mm = 1e3 * world.data.joint("object_flattened").qpos[0]
    bent_mm = 1e3 * world.data.joint("right_bend").qpos[0]
    law_n, _ = object_force_n(thing(name), flattened_mm, ruptured=False)
    assert 2.0 * force_n == pytest.approx(contact_n(world.sensor), rel=1e-6)
    assert force_n == pytest.approx(FINGER_N_PER_MM * bent_mm, rel=0.01)
    # Springs relax by 0.3 % at most.
    assert force_n == pytest.approx(law_n, rel=0.01)


@pytest.mark.parametrize("name", ["strawberry", "springs-8", "rigid-block"])
def test_contacts_give_way_little_whatever_they_touch(name: str) -> None:
    world = squeezed(name, by_mm=2.0)
    force_n = world.force_n(world.now_s())
    both_sides_mm = 2e3 * np.mean([-contact.dist for contact in world.data.contact])
    assert 0.0 < both_sides_mm / force_n < 0.04


@pytest.mark.slow
def test_a_fruit_relaxes_and_a_spring_does_not() -> None:
    spring, fruit = squeezed("springs-4"), squeezed("tomato")
    for world, least, most in ((spring, 0.99, 1.001), (fruit, 0.6, 0.97)):
        before_n = world.force_n(world.now_s())
        world.clock.sleep_s(20.0)
        assert least < world.force_n(world.now_s()) / before_n < most


def test_the_encoder_reads_where_the_fingers_were_sent() -> None:
    world = squeezed("springs-8")
    assert world.drive_value(world.now_s()) == pytest.approx(
        thing("springs-8").size_mm - 3.0, abs=0.1
    )


def test_the_first_finger_pushes_a_light_object_to_the_middle() -> None:
    world = squeezed("ball-44lbs")
    left_n, right_n = world.sensor.finger_n
    assert left_n == pytest.approx(right_n, abs=0.6)
    middle_mm = 1e3 * (world.data.geom("left_pad").xpos + world.data.geom("right_pad").xpos)[0]
    assert abs(middle_mm) < 1.0


def test_opening_lets_go() -> None:
    world = squeezed("strawberry")
    world.drive(74.0, rate=40.0)
    world.clock.sleep_s(2.0)
    assert world.force_n(world.now_s()) == 0.0
    assert not world.is_moving(world.now_s())


def test_the_same_seed_gives_the_same_frames() -> None:
    runs = []
    for _ in range(2):
        world = MujocoWorld(thing("strawberry"), seed=4)
        array = TwinArray(world)
        world.drive(33.0, rate=20.0)
        runs.append([array.read(timeout_s=0.1).counts.tolist() for _ in range(60)])
    assert runs[0] == runs[1]
    assert runs[0][0] != runs[0][-1]


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("springs-4", [[315, 255], [270, 301], [286, 280], [289, 274]]),
        ("strawberry", [[264, 230], [202, 239], [231, 251], [207, 223]]),
    ],
)
def test_frames_stay_what_they_were(name: str, counts: list[list[int]]) -> None:
    """Reading contacts faster must change no count; a new law of contact does."""
    obj = thing(name)
    world = MujocoWorld(obj, seed=1)
    array = TwinArray(world)
    world.drive(obj.size_mm - 2.0, rate=20.0)
    frames = [array.read(timeout_s=1.0) for _ in range(60)]
    assert frames[-1].counts.tolist() == counts


def test_asking_for_the_truth_changes_nothing() -> None:
    asked, left = squeezed("strawberry"), squeezed("strawberry")
    assert asked.truth(5.0) == asked.truth(5.0)
    for world in (asked, left):
        world.clock.sleep_s(1.0)
    assert asked.force_n(asked.now_s()) == left.force_n(left.now_s())
    assert asked.scan(asked.now_s()).tolist() == left.scan(left.now_s()).tolist()


@pytest.mark.slow
def test_truth_is_what_the_hold_comes_to() -> None:
    world = squeezed("tomato", wait_s=0.0)
    foreseen = world.truth()
    world.clock.sleep_s(20.0)
    assert world.truth() == replace(foreseen, peak_force_n=world.peak_force_n)
    assert foreseen.force_n == pytest.approx(world.force_n(world.now_s()), rel=1e-3)
    assert foreseen.settled_percent == pytest.approx(world.sensor.change_percent().mean(), abs=0.05)
    assert foreseen.size_mm == thing("tomato").size_mm
    world.drive(74.0, rate=40.0)
    world.clock.sleep_s(3.0)
    assert world.force_n(world.now_s()) == 0.0
    assert world.truth().force_n == foreseen.force_n


@pytest.mark.slow
def test_a_berry_that_is_crushed_is_damaged() -> None:
    for by_mm, damaged in ((15.0, True), (2.0, False)):
        world = squeezed("strawberry", by_mm=by_mm)
        force_n = world.force_n(world.now_s())
        assert (force_n > thing("strawberry").yield_n) == damaged
        assert world.truth().damaged == damaged


def test_a_new_object_needs_open_fingers_and_lies_elsewhere() -> None:
    world = squeezed("ball-44lbs")
    with pytest.raises(ValueError, match="open them first"):
        world.place(thing("ball-44lbs"))
    before = world.model.body("object").pos.copy()
    world.drive(74.0, rate=40.0)
    world.clock.sleep_s(3.0)
    world.place(thing("ball-44lbs"))
    assert world.force_n(world.now_s()) == 0.0
    assert world.drive_value(world.now_s()) == pytest.approx(74.0, abs=0.05)
    # From touch to touch at one placement it is a third of a millimetre.
    assert np.abs(world.model.body("object").pos - before).max() > 1.5e-3
