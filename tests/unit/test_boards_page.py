"""The page of boards matches the stored grasps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.parametrize(
    ("board", "label"),
    [("twin", "`sim-rigid`"), ("mega2560", "Mega 2560, hobby servo"), ("uno", "Uno, hobby servo")],
)
def test_boards_page_table_matches_stored_grasps(board: str, label: str) -> None:
    grasps = json.loads((DOCS / "boards" / f"{board}.json").read_text())["grasps"]
    held = [grasp for grasp in grasps if grasp["outcome"] == "held"]
    assert not any(grasp["damaged"] or grasp["frames_lost"] for grasp in grasps)
    peaks_n = [grasp["peak_force_n"] for grasp in grasps]
    answer_s, grasp_s = (
        np.median([grasp[name] for grasp in held]) for name in ("decision_time_s", "grasp_s")
    )
    row = (
        f"| {label} | {len(held)} of {len(grasps)} | {np.median(peaks_n):.2f} | "
        f"{max(peaks_n):.2f} | {answer_s:.2f} | {grasp_s:.2f} |"
    )
    assert row in (DOCS / "boards.md").read_text(encoding="utf-8")
