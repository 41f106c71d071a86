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


def test_truth_of_an_object_that_drops_after_the_hand_closed_further_remains_available() -> None:
    world = make_gripped_world(0.8)
    world.lift()
    world.drive(FRUIT.size_mm - 0.9, rate=20.0)
    world.clock.sleep_s(2.0)
    world.force_n(5.0)
    assert world.has_dropped
    truth = world.truth()
    assert truth.size_mm == FRUIT.size_mm
    assert truth.force_n > 0.0


def test_rising_pull_shifts_the_contact_before_it_slides_and_an_elastic_pull_yields() -> None:
    def slide(*, n_per_mm: float, has_partial_slip: bool = True) -> World:
        world = World(FRUIT, seed=1, has_partial_slip=has_partial_slip)
        world.drive(FRUIT.size_mm - 1.5, rate=20.0)
        world.clock.sleep_s(3.0)
        limit_n = 2.0 * FRUIT.friction * world.force_n(3.0)
        world.lift(
            more_n=1.2 * limit_n - N_PER_G * FRUIT.mass_g, rise_s=1.0, n_per_mm=n_per_mm * limit_n
        )
        return world

    shifted, stiff = (slide(n_per_mm=0.0, has_partial_slip=partial) for partial in (True, False))
    ohm = [world.pixel_resistance_ohm(3.65) for world in (shifted, stiff)]
    # Relaxation and the hysteresis of the sheet hide most of the shift.
    assert shifted.slid_mm == stiff.slid_mm == 0.0
    assert abs(ohm[0] / ohm[1] - 1.0).max() > 1e-4
    shifted.force_n(6.0)
    assert shifted.has_dropped
    assert shifted.slid_at_s is not None
    assert shifted.slid_at_s > 3.65
    elastic = slide(n_per_mm=0.2)
    elastic.force_n(6.0)
    assert 0.5 < elastic.slid_mm < 5.0


def test_opening_after_lift_puts_object_down() -> None:
    world = make_gripped_world(1.5)
    world.lift()
    world.clock.sleep_s(1.0)
    world.drive(74.0, rate=20.0)
    world.force_n(6.0)
    assert not world.has_dropped
