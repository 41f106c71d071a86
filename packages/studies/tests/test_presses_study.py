"""The press study: the given force, and separation of test data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate_studies.press_data import read_presses
from palpate_studies.presses import MODELS

HEADER = "recording_id,time_s,resistance_ohm,force_n\n"


def press_csv(path: Path, *, recordings: int = 4, presses: int = 4) -> Path:
    """Write synthetic recordings: ramps of 0.4 s to 10 N, 1.2 s hold, sudden release."""
    lines = []
    time_s = np.arange(0, 4.0 * presses, 0.02)
    phase = time_s % 4.0
    creep = 1 + 0.15 * np.log1p(np.maximum(phase - 2.0, 0) / 0.05)
    for recording in range(recordings):
        rng = np.random.default_rng(recording)
        peak = rng.uniform(8, 12)
        force = np.interp(phase, [0, 2.0, 2.4, 3.6, 3.62, 4], [0, 0, peak, peak, 0, 0])
        ohm = 1000 / (1 + 3 * np.exp(rng.normal(0, 0.3)) * force**0.9 * creep)
        rows = zip(time_s, ohm, force, strict=True)
        lines += [f"shape{recording}_exp1,{t:.2f},{r:.4f},{f:.4f}" for t, r, f in rows]
    path.write_text(HEADER + "\n".join(lines) + "\n")
    return path


@pytest.mark.slow
def test_follower_reads_reference_force_once(tmp_path: Path) -> None:
    presses = read_presses(press_csv(tmp_path / "p.csv"))
    press = presses[3]
    hidden = press.trace.force_n.copy()
    hidden[np.arange(len(hidden)) != press.trace.given] = 99.0
    blind = replace(press, trace=replace(press.trace, force_n=hidden))
    for name, learn in MODELS.items():
        follow = learn(presses)
        assert follow(blind)[0].tolist() == follow(press)[0].tolist(), name


@pytest.mark.slow
def test_study_with_test_recordings_scores_only_these(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    known = press_csv(tmp_path / "known.csv")
    tested = press_csv(tmp_path / "tested.csv", recordings=1, presses=3)
    rows = document("presses", "--recordings", known, "--test-recordings", tested)["rows"]
    assert len(rows) == 3 * len(MODELS)
    assert {(row["recording_id"], row["press"]) for row in rows} == {
        ("shape0_exp1", press) for press in range(3)
    }
