"""Crosstalk correction of the twin's readings, compared with the true pixel values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout
from palpate.sensor.sample import pixel_resistance_ohm
from palpate.signal.circuit import resistance_ohm
from palpate.twin.objects import draw_object
from palpate.twin.world import World


@pytest.mark.parametrize("layout", [RIGID_LAYOUT, SOFT_LAYOUT])
@pytest.mark.parametrize(("oversampling", "worst"), [(1, 0.05), (64, 0.012)])
def test_pixel_resistance_recovers_the_twin_pixels_from_crosstalk(
    layout: ArrayLayout, oversampling: int, worst: float
) -> None:
    wired = replace(layout, idle_lines="floating")
    raw, unmixed = [], []
    for seed in range(4):
        obj = draw_object(np.random.default_rng(seed), "ball-44lbs")
        world = World(obj, seed=seed, layout=wired, oversampling=oversampling)
        world.drive(42.0, rate=20.0)
        counts, truth = [], []
        for time_s in 6.0 + np.arange(15) / 15:
            counts.append(world.scan(time_s))
            truth.append(world.pixel_resistance_ohm(time_s))
        read = resistance_ohm(counts, divider=layout.divider, oversampling=oversampling)
        solved = pixel_resistance_ohm(counts, layout=wired, oversampling=oversampling)
        assert not np.isnan(solved).any()
        # Pixels that contribute less than a tenth of their reading are dominated by rounding.
        good = read / truth > 0.1
        raw += list(np.abs(read / truth - 1)[good])
        unmixed += list(np.abs(solved / truth - 1)[good])
    assert np.median(raw) > 0.3
    assert np.max(unmixed) < worst
