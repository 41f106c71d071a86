"""Force from closure and its distribution over pixels, compared with hand calculations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout
from palpate.twin.mechanics import (
    HandCompliance,
    object_force_n,
    pixel_fractions,
    series_force_n,
)
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.placement import PixelGrid

#: A linear spring.
THING = TwinObject(
    name="thing",
    size_mm=40.0,
    contact="linear",
    force_at_1mm_n=4.0,
    relaxing_fractions=(),
    relaxing_time_s=(),
    flat=True,
)
SPRING = HandCompliance(finger_mm_per_n=0.25, pad_travel_mm=0.0, pad_force_n=1.0)
PADS = HandCompliance(finger_mm_per_n=0.2, pad_travel_mm=0.4, pad_force_n=2.0)


def test_series_force_of_two_springs_matches_hand_calculation() -> None:
    # 4 N/mm and 0.25 mm/N fractions 3 mm evenly: 1.5 mm each, 6 N.
    assert series_force_n(THING, 3.0, compliance=SPRING) == pytest.approx(6.0)


@pytest.mark.parametrize("name", ["strawberry", "springs-4", "dragonskin-20"])
def test_series_force_deformations_sum_to_closure(name: str) -> None:
    obj = draw_object(np.random.default_rng(5), name)
    for closure_mm in (0.01, 0.5, 2.0, 6.0, 20.0):
        force_n = series_force_n(obj, closure_mm, compliance=PADS)
        deformation_mm = closure_mm - PADS.deflection_mm(force_n)
        expected_n, _ = object_force_n(obj, deformation_mm, ruptured=False)
        assert expected_n == pytest.approx(force_n, rel=1e-6)


def test_series_force_yield_lowers_slope_and_rupture_lowers_force() -> None:
    fruit = replace(THING, yield_n=6.0, rupture_n=8.0)
    closures = np.linspace(0.1, 4.0, 40)
    forces = np.array([series_force_n(fruit, c, compliance=SPRING) for c in closures])
    slopes = np.diff(forces) / np.diff(closures)
    assert np.all(slopes > 0)
    assert slopes[-1] < 0.6 * slopes[0]
    burst = series_force_n(fruit, 4.0, compliance=SPRING, ruptured=True)
    assert burst < 0.7 * forces[-1]


@pytest.mark.parametrize("layout", [RIGID_LAYOUT, SOFT_LAYOUT])
@pytest.mark.parametrize("flat", [True, False])
def test_pixel_fractions_sum_to_one_per_finger(layout: ArrayLayout, flat: bool) -> None:
    grid = PixelGrid.from_layout(layout)
    for spot in [(0.0, 0.0), (6.0, -6.0)]:
        fractions = pixel_fractions(replace(THING, flat=flat), 2.0, grid=grid, off_centre_mm=spot)
        assert np.all(fractions >= 0)
        for finger in range(layout.fingers):
            assert fractions[layout.finger_mask(finger).ravel()].sum() == pytest.approx(1.0)


def test_pixel_fractions_of_off_centre_fruit_leave_pixels_unloaded() -> None:
    grid, fruit = PixelGrid.from_layout(RIGID_LAYOUT), replace(THING, flat=False)
    light, deep = (
        int(np.sum(pixel_fractions(fruit, mm, grid=grid, off_centre_mm=(6.0, 6.0)) == 0))
        for mm in (1.0, 8.0)
    )
    assert deep < light >= 2


def test_draw_object_values_are_within_ranges() -> None:
    for seed in range(30):
        berry = draw_object(np.random.default_rng(seed), "strawberry")
        assert 31 <= berry.size_mm <= 41
        assert 0 < berry.yield_n < berry.rupture_n
        assert sum(berry.relaxing_fractions) < 0.5
    assert draw_object(np.random.default_rng(3)) == draw_object(np.random.default_rng(3))
    with pytest.raises(ValueError, match="strawberry"):
        draw_object(np.random.default_rng(0), "cucumber")
