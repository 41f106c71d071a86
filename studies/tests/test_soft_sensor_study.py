"""The soft-sensor study: a stroke sees its own past only, and our model learns a bent law."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import build_app, run
from palpate_studies.soft_sensor import MODELS, read_strokes

HEADER = "stroke_id,sample,location_mm,depth_mm,speed_mm_s,voltage_v,force_n\n"


def soft_csv(path: Path, *, strokes: int = 24) -> Path:
    """Write invented strokes at two depths: force and voltage rise and fall, the latter late."""
    rng = np.random.default_rng(3)
    lines = []
    for stroke in range(strokes):
        depth = (0.5, 1.0, 1.4)[stroke % 3]
        force = 8 * depth * np.sin(np.linspace(0, np.pi, 14)) + rng.normal(0, 0.02, 14)
        late = np.concatenate([[force[0]], 0.7 * force[1:] + 0.3 * force[:-1]])
        voltage = 0.05 + 0.002 * np.maximum(late, 0) ** 2
        lines += [
            f"{stroke},{k},0,{depth},1,{v:.6f},{f:.4f}"
            for k, (v, f) in enumerate(zip(voltage, force, strict=True))
        ]
    path.write_text(HEADER + "\n".join(lines) + "\n")
    return path


def test_later_samples_change_nothing_said_before(tmp_path: Path) -> None:
    strokes = read_strokes(soft_csv(tmp_path / "s.csv"))
    text = (tmp_path / "s.csv").read_text().splitlines()
    (tmp_path / "t.csv").write_text("\n".join(text[:10]) + "\n")
    part = read_strokes(tmp_path / "t.csv")[0]
    np.testing.assert_array_equal(part.inputs, strokes[0].inputs[: len(part.inputs)])


def test_ours_beats_the_static_cubic(tmp_path: Path) -> None:
    strokes = read_strokes(soft_csv(tmp_path / "s.csv"))
    train, tested = strokes[:18], strokes[18:]

    def error_n(name: str) -> float:
        predict = MODELS[name](train)
        return float(np.mean([np.abs(predict(one)[0] - one.force_n).mean() for one in tested]))

    assert error_n("ours") < 0.7 * error_n("static") < error_n("constant")


def test_study_prints_one_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("sklearn")
    path = str(soft_csv(tmp_path / "s.csv"))
    arguments = ["study", "soft-sensor", "--train", path, "--test", path, "--json"]
    assert run(build_app(), arguments, name="palpate") == 0
    summary = json.loads(capsys.readouterr().out)["summary"]
    assert [one["model"] for one in summary] == list(MODELS)
    assert all(one["rms_n"] >= 0 for one in summary)


def test_an_empty_file_gets_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "s.csv"
    path.write_text(HEADER)
    assert run(build_app(), ["study", "soft-sensor", "--train", str(path)], name="palpate") == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
