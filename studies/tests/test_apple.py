"""Simulated apples between two fingers, sound and bruised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.mechanics import pixel_fractions
from palpate.twin.placement import PixelGrid
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


def test_bruise_reduces_load_on_its_pixels_only(ball: Apple) -> None:
    bruised = replace(ball, bruise=replace(BRUISE, angle_deg=10.0, height_mm=4.0))
    before, after = shares(ball), shares(bruised)
    assert before == pytest.approx(np.full(8, 0.25))
    assert after[3] < 0.8 * before[3]
    assert after[0] > before[0]
    assert after[4:] == pytest.approx(before[4:], abs=0.01)
    front, back = shares(bruised).reshape(2, 2, 2), shares(bruised, 180.0).reshape(2, 2, 2)
    assert back[1] == pytest.approx(front[0][:, ::-1])
