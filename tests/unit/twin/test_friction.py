"""Lifting, slipping, first contact, and backlash of the fingers."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.factories import draw

from palpate.twin.friction import N_PER_G
from palpate.twin.world import World

FRUIT = replace(draw("tomato", 1), friction=0.5, mass_g=100.0)


def make_gripped_world(closure_mm: float) -> World:
    world = World(FRUIT, seed=1)
    world.drive(FRUIT.size_mm - closure_mm, rate=20.0)
    world.clock.sleep_s(3.0)
    return world


@pytest.mark.parametrize(("closure_mm", "drops"), [(1.5, False), (0.8, True)])
def test_lift_holds_only_what_friction_can_carry(closure_mm: float, drops: bool) -> None:
    world = make_gripped_world(closure_mm)
    assert (2 * 0.5 * world.force_n(3.0) < 100.0 * N_PER_G) == drops
    world.lift()
    assert (world.force_n(4.0) == 0.0) == drops
    assert (world.force_n(6.0) > 1.0) != drops
    assert world.has_dropped == drops
    # The truth about a dropped object remains available.
    assert world.truth().size_mm == FRUIT.size_mm


def test_opening_after_lift_puts_object_down() -> None:
    world = make_gripped_world(1.5)
    world.lift()
    world.clock.sleep_s(1.0)
    world.drive(74.0, rate=20.0)
    world.force_n(6.0)
    assert not world.has_dropped
