"""Table 6 with a supported apple, and Figure 16 with other soft fingers."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.sensor.array import SOFT_LAYOUT
from palpate.twin.placement import PixelGrid
from palpate_studies.dropped_apple import CLOSURE_MM, DROPPED, SIZE_MM, grasp_free, grasp_supported
from palpate_studies.figure16 import GrowingContact, scores


def test_supported_apple_keeps_the_load_of_its_sound_side() -> None:
    free, held = grasp_free("lab", 70_002, repeats=2), grasp_supported("lab", 70_002, repeats=2)
    before, after, bruised = (
        held.values(column, "recorded", 20.0).mean()
        for column in ("before", "after", "only bruised")
    )
    assert 2.0 * after - bruised == pytest.approx(before, abs=3.0)
    assert bruised > free.values("only bruised", "recorded", 20.0).mean() + 4.0
    assert held.support_n > 1.0
    assert free.support_n == 0.0
    settled = [free.values(name, "recorded", 20.0).mean() for name in ("before", "after")]
    assert settled[0] < settled[1] < 0
    assert DROPPED.dent_mm < CLOSURE_MM < SIZE_MM


@pytest.mark.parametrize("deformation_mm", [0.0, 4.0])
def test_growing_contact_loses_load_beyond_the_pixels(deformation_mm: float) -> None:
    """A contact of 8 mm lies within 30 x 20 mm, one of 16 mm does not."""
    grid = PixelGrid.of(SOFT_LAYOUT)
    shares = GrowingContact(size_mm=64.0).pixel_shares(
        deformation_mm, grid=grid, off_centre_mm=(0.0, 0.0)
    )
    caught = [shares[grid.finger == finger].sum() for finger in (0, 1)]
    reach_mm = 8.0 if deformation_mm == 0.0 else 16.0
    along, across = np.meshgrid(np.linspace(-16, 16, 801), np.linspace(-16, 16, 801))
    pressure = np.maximum(1.0 - (along**2 + across**2) / reach_mm**2, 0.0)
    covered = (np.abs(along) < 15.0) & (np.abs(across) < 10.0)
    assert caught == pytest.approx([pressure[covered].sum() / pressure.sum()] * 2, abs=0.015)
    assert (caught[0] > 0.98) == (deformation_mm == 0.0)


def test_trend_is_counted_by_fruit() -> None:
    falls = np.array([-40.0, -35.0, -30.0, -25.0])[:, None] + np.array([-0.5, 0.5])
    stays = np.array([-40.0, -41.0, -40.5, -39.5])[:, None] + np.array([-0.5, 0.5])
    found = scores(np.array([falls, stays]))
    assert (found["falls_every_day"], found["falls_clearly"], found["fruits"]) == (1, 1, 2)
