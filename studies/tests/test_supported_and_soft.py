"""Table 6 with a supported apple, and the scores of Figure 16."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_studies.figure16 import scores
from palpate_studies.table6 import CLOSURE_MM, DROPPED, SIZE_MM, grasp_free, grasp_supported


def test_supported_apple_sound_side_keeps_its_load() -> None:
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


def test_figure16_scores_count_fruits_with_trend() -> None:
    falls = np.array([-40.0, -35.0, -30.0, -25.0])[:, None] + np.array([-0.5, 0.5])
    stays = np.array([-40.0, -41.0, -40.5, -39.5])[:, None] + np.array([-0.5, 0.5])
    found = scores(np.array([falls, stays]))
    assert (found["falls_every_day"], found["falls_clearly"], found["fruits"]) == (1, 1, 2)
