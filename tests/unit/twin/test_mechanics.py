"""Force from closure, and its spread over pixels, against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout
from palpate.twin.mechanics import (
    HandCompliance,
    Motion,
    PixelGrid,
    object_force_n,
    pixel_shares,
    series_force_n,
)
from palpate.twin.objects import OBJECTS, TwinObject, draw_object


def thing(**changes: object) -> TwinObject:
    given = {
        "name": "thing",
        "size_mm": 40.0,
        "contact": "linear",
        "force_at_1mm_n": 4.0,
        "relaxing_share": (),
        "relaxing_time_s": (),
        "flat": True,
    }
    return TwinObject(**(given | changes))  # type: ignore[arg-type]


STIFF = HandCompliance(finger_mm_per_n=0.0, pad_travel_mm=0.0, pad_force_n=1.0)
SPRING = HandCompliance(finger_mm_per_n=0.25, pad_travel_mm=0.0, pad_force_n=1.0)
PADS = HandCompliance(finger_mm_per_n=0.2, pad_travel_mm=0.4, pad_force_n=2.0)


def test_two_springs_in_series() -> None:
    # 4 N/mm and 0.25 mm/N share 3 mm evenly: 1.5 mm each, 6 N.
    assert series_force_n(thing(), 3.0, compliance=SPRING) == pytest.approx(6.0)


def test_hertz_contact_between_rigid_fingers() -> None:
    ball = thing(contact="hertz")
    assert series_force_n(ball, 4.0, compliance=STIFF) == pytest.approx(4.0 * 4.0**1.5)


@pytest.mark.parametrize("name", OBJECTS)
def test_closure_is_shared_without_loss(name: str) -> None:
    obj = draw_object(np.random.default_rng(5), name)
    for closure_mm in (0.01, 0.5, 2.0, 6.0, 20.0):
        force_n = series_force_n(obj, closure_mm, compliance=PADS)
        deformation_mm = closure_mm - PADS.deflection_mm(force_n)
        again_n, _ = object_force_n(obj, deformation_mm, ruptured=False)
        assert again_n == pytest.approx(force_n, rel=1e-6)


def test_no_force_without_contact() -> None:
    assert series_force_n(thing(), -1.0, compliance=PADS) == 0.0
    assert series_force_n(thing(), 0.0, compliance=PADS) == 0.0


def test_yield_flattens_and_rupture_weakens() -> None:
    fruit = thing(yield_n=6.0, rupture_n=8.0)
    closures = np.linspace(0.1, 4.0, 40)
    forces = np.array([series_force_n(fruit, c, compliance=SPRING) for c in closures])
    slopes = np.diff(forces) / np.diff(closures)
    assert np.all(slopes > 0)
    assert slopes[-1] < 0.6 * slopes[0]
    burst = series_force_n(fruit, 4.0, compliance=SPRING, ruptured=True)
    assert burst < 0.7 * forces[-1]


@pytest.mark.parametrize("layout", [RIGID_LAYOUT, SOFT_LAYOUT])
@pytest.mark.parametrize("flat", [True, False])
def test_pixels_carry_their_fingers_whole_force(layout: ArrayLayout, flat: bool) -> None:
    grid = PixelGrid.of(layout)
    for spot in [(0.0, 0.0), (6.0, -6.0)]:
        share = pixel_shares(thing(flat=flat), 2.0, grid=grid, off_centre_mm=spot)
        assert np.all(share >= 0)
        for finger in range(layout.fingers):
            assert share[layout.finger_mask(finger).ravel()].sum() == pytest.approx(1.0)


def test_off_centre_fruit_misses_some_pixels() -> None:
    grid = PixelGrid.of(RIGID_LAYOUT)
    aside = pixel_shares(thing(flat=False), 1.0, grid=grid, off_centre_mm=(6.0, 6.0))
    assert np.sum(aside == 0) >= 2
    deeper = pixel_shares(thing(flat=False), 8.0, grid=grid, off_centre_mm=(6.0, 6.0))
    assert np.sum(deeper == 0) < np.sum(aside == 0)


def test_motion_goes_at_its_rate_and_stops() -> None:
    closing = Motion(start_s=1.0, from_mm=50.0, to_mm=40.0, rate_mm_per_s=20.0)
    assert closing.end_s == pytest.approx(1.5)
    assert [closing.width_mm(t) for t in (0.0, 1.25, 3.0)] == [50.0, 45.0, 40.0]


def test_drawn_objects_keep_to_their_ranges() -> None:
    for seed in range(30):
        berry = draw_object(np.random.default_rng(seed), "strawberry")
        assert 31 <= berry.size_mm <= 41
        assert 0 < berry.yield_n < berry.rupture_n
        assert sum(berry.relaxing_share) < 0.5
    assert draw_object(np.random.default_rng(3)) == draw_object(np.random.default_rng(3))
    with pytest.raises(ValueError, match="strawberry"):
        draw_object(np.random.default_rng(0), "cucumber")
