"""The study of `palpate qualify` on synthetic apples and pools."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.produce.qualify import agreement
from palpate_studies.qualify import FIGURES, Pool, check_coverage, read_side_pairs


def test_read_side_pairs_reads_both_sides(tmp_path: Path) -> None:
    path = tmp_path / "apples.csv"
    path.write_text("side1_lbf,side2_lbf\n15,16\n14,\n")
    pairs = read_side_pairs(path)
    assert pairs.items == 2
    assert int(pairs.has_both.sum()) == 1
    assert np.isfinite(pairs.reference).sum() == 3


@pytest.mark.slow
def test_check_coverage_of_good_instrument_covers_true_figures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(agreement, "_DRAWS", 100)
    random = np.random.default_rng(1)
    truth = random.normal(1.0, 0.6, 80)
    pool = Pool(truth=truth, grasps=truth[:, None] + random.normal(0.0, 0.1, (80, 2)))
    rows = check_coverage(pool, 0.3, level="lab", campaigns=10)
    assert {row["figure"] for row in rows} <= set(FIGURES)
    assert all(row["coverage"] >= 0.6 for row in rows)
