"""A whole world: cause and effect, determinism, truth, realistic difficulty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.factories import draw

from palpate.sensor.sample import relative_change_percent
from palpate.signal.relative import mean_change
from palpate.twin.objects import TwinObject
from palpate.twin.velostat import FAMILIES
from palpate.twin.world import World


def make_object(name: str = "dragonskin-10") -> TwinObject:
    return draw(name, 1)


def make_held_world(closure_mm: float, *, seed: int = 1, **options: object) -> World:
    """Return a world whose fingers start at 0 s to a closure beyond contact."""
    obj = make_object()
    world = World(obj, seed=seed, **options)  # type: ignore[arg-type]
    world.drive(obj.size_mm - closure_mm, rate=40.0)
    return world


def rest_ohm(world: World) -> np.ndarray:
    return world.sheet.rest_ohm.reshape(world.layout.rows, world.layout.cols)


def mean_change_percent(world: World, time_s: float) -> float:
    """Return the noise-free mean relative change."""
    ohm = world.pixel_resistance_ohm(time_s)
    return mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm(world))).item()


@pytest.mark.parametrize("family", FAMILIES)
def test_world_closing_raises_force_and_lowers_resistance(family: str) -> None:
    worlds = [make_held_world(c, level="field", family=family) for c in (0.5, 1.0, 2.0, 3.0)]
    forces = [world.force_n(10.0) for world in worlds]
    changes = [mean_change_percent(world, 10.0) for world in worlds]
    assert np.all(np.diff(forces) > 0)
    assert np.all(np.diff(changes) < 0)
    assert changes[-1] > -100.0


def test_world_truth_during_hold_equals_settled_force_and_change() -> None:
    world = make_held_world(2.5)
    world.force_n(1.0)
    before = world.truth()
    assert before.force_n == pytest.approx(world.force_n(20.0), rel=1e-9)
    assert before.settled_percent == pytest.approx(mean_change_percent(world, 20.0), abs=1e-9)
    after = world.truth()
    assert replace(after, peak_force_n=0.0) == replace(before, peak_force_n=0.0)
    assert after.peak_force_n >= before.force_n
    assert after.size_mm == make_object().size_mm


def test_world_true_stiffness_excludes_gripper_compliance() -> None:
    springs = make_object("springs-4")
    world = World(springs, seed=4)
    world.drive(springs.size_mm - 3.0, rate=20.0)
    world.force_n(1.0)
    truth = world.truth()
    assert truth.stiffness_n_per_mm == pytest.approx(springs.force_at_1mm_n, rel=0.01)
    # With the gripper's compliance, the stiffness would be much lower.
    assert truth.force_n / 3.0 < 0.75 * springs.force_at_1mm_n


def test_world_without_object_has_no_force() -> None:
    world = World(None, seed=1)
    world.drive(10.0, rate=50.0)
    assert world.force_n(5.0) == 0.0
    truth = world.truth()
    assert (truth.size_mm, truth.stiffness_n_per_mm, truth.force_n) == (None, None, 0.0)
    assert truth.settled_percent == pytest.approx(0.0, abs=0.01)


def test_world_squeezed_berry_is_damaged() -> None:
    berry = make_object("strawberry")
    gentle, rough = World(berry, seed=1), World(berry, seed=1)
    gentle.drive(berry.size_mm - 1.0, rate=20.0)
    rough.drive(berry.size_mm - 12.0, rate=20.0)
    for world in (gentle, rough):
        world.force_n(3.0)
    assert not gentle.truth().damaged
    assert rough.truth().damaged
    assert rough.truth().peak_force_n >= berry.yield_n


def test_world_servo_locks_at_force_limit() -> None:
    block = make_object("rigid-block")
    world = World(block, seed=1)
    world.drive(5.0, rate=20.0)
    assert world.force_n(10.0) < 65.0
    assert not world.is_moving(10.0)
    assert world.drive_value(10.0) > 15.0
