"""Simulated apples between two fingers, sound and bruised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.mechanics import pixel_fractions
from palpate.twin.placement import PixelGrid
from palpate_studies.fruit_ranges import BRUISES
from palpate_studies.twin_apple import Apple, Bruise, draw_apple

GRID = PixelGrid.from_layout(RIGID_LAYOUT)
BRUISE = Bruise(
    angle_deg=0.0, height_mm=0.0, diameter_mm=20.0, depth_mm=7.0, softness=0.3, dent_mm=0.5
)


@pytest.fixture
def ball() -> Apple:
    """Return an apple that is perfectly round and equally firm."""
    drawn = draw_apple(np.random.default_rng(3), bruises=None)
    return replace(drawn, oval=0.0, lobes=0.0, firmer=0.0, leaning_mm=0.0)


def shares(apple: Apple, angle_deg: float = 0.0, **where: tuple[float, float]) -> np.ndarray:
    off_centre_mm = where.get("off_centre_mm", (0.0, 0.0))
    return pixel_fractions(apple.facing(angle_deg), 0.8, grid=GRID, off_centre_mm=off_centre_mm)


def test_facing_round_sound_apple_equals_its_flesh(ball: Apple) -> None:
    facing = ball.facing(123.0)
    assert facing.size_mm == pytest.approx(ball.flesh.size_mm)
    assert facing.force_at_1mm_n == pytest.approx(ball.flesh.force_at_1mm_n)
    assert shares(ball) == pytest.approx(np.full(8, 0.25))


def test_pixel_shares_of_sound_apple_sum_to_one_per_finger() -> None:
    apple = draw_apple(np.random.default_rng(4), bruises=None)
    found = shares(apple, 40.0, off_centre_mm=(4.0, -5.0)).reshape(2, 4)
    assert found.sum(axis=1) == pytest.approx([1.0, 1.0])
    assert found.max() > 0.5


def test_width_around_apple_varies_with_ovality(ball: Apple) -> None:
    oval = replace(ball, oval=0.01, oval_deg=30.0)
    along, across = (oval.facing(angle).size_mm for angle in (30.0, 120.0))
    assert along - across == pytest.approx(4 * 0.01 * ball.radius_mm)


def test_bruise_reduces_load_on_its_pixels_only(
    ball: Apple,
) -> None:
    bruised = replace(ball, bruise=replace(BRUISE, angle_deg=10.0, height_mm=4.0))
    before, after = (shares(one, off_centre_mm=(0.0, 0.0)) for one in (ball, bruised))
    assert after[3] < 0.8 * before[3]
    assert after[0] > before[0]
    assert after[4:] == pytest.approx(before[4:], abs=0.01)


def test_apple_turned_by_180_degrees_mirrors_bruise_on_other_finger(ball: Apple) -> None:
    bruised = replace(ball, bruise=replace(BRUISE, angle_deg=10.0, height_mm=4.0))
    front, back = shares(bruised, 0.0).reshape(2, 2, 2), shares(bruised, 180.0).reshape(2, 2, 2)
    assert back[1] == pytest.approx(front[0][:, ::-1])


def test_dent_reduces_size_and_soft_flesh_reduces_stiffness(ball: Apple) -> None:
    dented = replace(ball, bruise=replace(BRUISE, softness=1.0)).facing(0.0)
    soft = replace(ball, bruise=replace(BRUISE, dent_mm=0.0)).facing(0.0)
    assert dented.size_mm == pytest.approx(ball.flesh.size_mm - 0.5)
    assert soft.size_mm == pytest.approx(ball.flesh.size_mm)
    assert soft.force_at_1mm_n < 0.8 * ball.flesh.force_at_1mm_n


def test_flat_dent_spreads_load_outside_the_pixels(ball: Apple) -> None:
    flat = replace(BRUISE, diameter_mm=30.0, softness=1.0, dent_mm=0.75 * 30.0**2 / 8 / 33)
    found = shares(replace(ball, bruise=flat)).reshape(2, 4).sum(axis=1)
    assert found[0] < 0.95
    assert found[1] == pytest.approx(1.0)


def test_bruise_of_sound_flesh_without_dent_has_no_effect(ball: Apple) -> None:
    nothing = replace(ball, bruise=replace(BRUISE, softness=1.0, dent_mm=0.0))
    assert shares(nothing) == pytest.approx(shares(ball))
    assert nothing.facing(0.0).force_at_1mm_n == pytest.approx(ball.flesh.force_at_1mm_n)


def test_bruise_away_from_fingers_has_no_effect(ball: Apple) -> None:
    bruised = replace(ball, bruise=BRUISE)
    assert bruised.facing(90.0) == ball.facing(90.0)


def test_draw_apple_bruise_is_within_ranges() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        bruise = draw_apple(rng, bruises=BRUISES).bruise
        assert bruise is not None
        assert 1.0 <= bruise.area_cm2 <= 7.1
        assert abs(bruise.height_mm) <= 10.0
        assert 0.2 <= bruise.softness <= 0.6
