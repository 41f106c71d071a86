"""The studies of a microfluidic soft sensor and of a hydrogel sensor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate_studies.hydrogel import read_contacts, score
from palpate_studies.soft_sensor import MODELS

HEADER = "stroke_id,sample,location_mm,depth_mm,speed_mm_s,voltage_v,force_n\n"


def soft_csv(path: Path, *, strokes: int = 24, depths: tuple[float, ...] = (0.5, 1.0, 1.4)) -> Path:
    """Write strokes with a delayed, nonlinear voltage."""
    rng = np.random.default_rng(3)
    lines = []
    for stroke in range(strokes):
        depth = depths[stroke % len(depths)]
        force = 8 * depth * np.sin(np.linspace(0.1, np.pi - 0.1, 14)) + rng.normal(0, 0.02, 14)
        late = np.concatenate([[force[0]], 0.7 * force[1:] + 0.3 * force[:-1]])
        voltage = 0.03 + 0.002 * np.maximum(late, 0) ** 2
        lines += [
            f"{stroke},{k},0,{depth},1,{v:.6f},{f:.4f}"
            for k, (v, f) in enumerate(zip(voltage, force, strict=True))
        ]
    path.write_text(HEADER + "\n".join(lines) + "\n")
    return path


def test_soft_sensor_command_prints_row_per_model_and_depth(
    tmp_path: Path, document: Callable[..., Any]
) -> None:
    pytest.importorskip("sklearn")
    path = soft_csv(tmp_path / "strokes.csv")
    summary = document("soft-sensor", "--train", path)["summary"]
    assert [one["model"] for one in summary] == 3 * list(MODELS)
    summary = document("soft-sensor", "--train", path, "--test", path)["summary"]
    assert [one["split"] for one in summary] == len(MODELS) * ["test"]
    assert {"rms_n", "rms_n_loading", "rms_n_unloading"} <= set(summary[0])


def loop_csv(path: Path, *, recordings: int = 2, rest: int = 30) -> Path:
    """Write recordings of two presses each, of a sensor whose conductance follows the force."""
    channels = [f"v{number:02d}" for number in range(1, 17)]
    rows = [",".join(["recording", "time_s", "press", "force_n", "lstm_n", *channels])]
    force_n = np.concatenate([np.zeros(rest), 20.0 * np.sin(np.linspace(0.0, np.pi, 80)) ** 2])
    for recording in range(recordings):
        for press in range(2):
            for number, force in enumerate(force_n):
                voltage = 3.3 / (1.0 + 0.0005 * force)
                time_s = 0.05 * (number + press * len(force_n))
                cells = [f"r{recording}", time_s, press, force, force + 1.0, *[voltage] * 16]
                rows.append(",".join(str(cell) for cell in cells))
    path.write_text("\n".join(rows) + "\n")
    return path


def test_hydrogel_score_on_held_out_recording_beats_mean_force(tmp_path: Path) -> None:
    contacts = read_contacts(loop_csv(tmp_path / "loop.csv"))
    rows = {row["method"]: row for row in score(contacts[:2], tested=contacts[2:])}
    assert rows["ours"]["median_abs_log_error"] < 0.5 * rows["mean force"]["median_abs_log_error"]
    assert rows["ours"]["coverage"] > 0.8
    assert rows["authors' LSTM"]["rms_n"] == pytest.approx(1.0)
