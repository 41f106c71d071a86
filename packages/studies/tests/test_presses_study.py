"""The press study: cutting of presses, the given force, and separation of test data."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate_studies.press_data import Press, read_presses
from palpate_studies.presses import MODELS, compare_with_cell

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
def test_study_prints_one_document(tmp_path: Path, document: Callable[..., Any]) -> None:
    path = press_csv(tmp_path / "p.csv")
    found = document("presses", "--recordings", path)
    assert {row["model"] for row in found["summary"]} == {*MODELS}
    settings = {"all", *(f"shape{k}" for k in range(4))}
    assert {row["setting"] for row in found["summary"]} == settings
    overall = {one["model"]: one for one in found["summary"] if one["setting"] == "all"}
    assert overall["ours"]["presses"] == 16


@pytest.fixture(scope="module")
def real_presses(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Press]:
    """Return the presses of the first repeat of every setting."""
    path = tmp_path_factory.mktemp("presses") / "exp1.csv"
    with gzip.open(real_data / "velostat_presses.csv.gz", "rt") as source, path.open("w") as few:
        rows = csv.reader(source)
        csv.writer(few).writerows(row for row in rows if "_exp2" not in row[0])
    return read_presses(path)


@pytest.mark.slow
def test_force_law_on_held_out_settings_beats_static_law(real_presses: list[Press]) -> None:
    left_out = {"pike2_sensor1", "pike1_force_10_sensor1", "pike1_force_30_sensor1"}
    known = [p for p in real_presses if p.trace.group not in left_out][::3]
    tested = [p for p in real_presses if p.trace.group in left_out][::3]
    static, ours = (
        [compare_with_cell(press, follow(press)) for press in tested]
        for follow in (MODELS["static"](known), MODELS["ours"](known))
    )
    for error in (lambda one: np.median(np.abs(one)), lambda one: abs(one[-1])):
        before, after = (
            np.median([error(one.log_error) for one in followed]) for followed in (static, ours)
        )
        assert after <= 0.6 * before
    assert 0.8 <= np.mean([np.mean(one.covered) for one in ours]) <= 0.99


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
