"""The paper's method on the twin: contact by the mean of all pixels, size, settled value, force."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from palpate.cli import build_app, run
from palpate.errors import RecordingError
from palpate.grasp.paper import Paper
from palpate.twin.firmware import BUILD

pytestmark = pytest.mark.slow

Capture = pytest.CaptureFixture[str]


def palpate(*arguments: str) -> int:
    return run(build_app(), list(arguments), name="palpate")


def document(capsys: Capture, *arguments: str, status: int = 0) -> dict[str, Any]:
    assert palpate(*arguments, "--json") == status
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def grasped(capsys: Capture, *options: str) -> dict[str, Any]:
    return document(capsys, "grasp", "--method", "paper", "--seed", "3", *options)


def test_paper_method_on_rigid_fingers_gives_size_and_force(capsys: Capture) -> None:
    found = grasped(capsys, "--object", "strawberry")
    assert found["outcome"] == "held"
    assert found["decision_time_s"] == pytest.approx(2.5, abs=0.2)
    size, truth = found["size_mm"], found["truth"]
    assert size["value"] == pytest.approx(truth["size_mm"], abs=2.0)
    assert size["value"] - size["low"] == pytest.approx(1.0, abs=0.06)
    assert found["force_n"] is not None
    assert found["stiffness_n_per_mm"] is None


def test_paper_method_on_fingers_driven_by_pressure_gives_no_size(capsys: Capture) -> None:
    found = grasped(capsys, "--rig", "sim-soft")
    assert (found["outcome"], found["size_mm"], found["previous_width_mm"]) == ("held", None, None)


def test_paper_method_through_the_firmware_holds_the_object(capsys: Capture) -> None:
    if not (BUILD / "libpalpate_board.so").exists():
        pytest.skip("no firmware simulator")
    found = grasped(capsys, "--rig", "sim-firmware", "--object", "strawberry")
    assert found["outcome"] == "held"
    assert found["size_mm"]["value"] == pytest.approx(found["truth"]["size_mm"], abs=2.0)


def test_extra_closing_presses_more(capsys: Capture) -> None:
    forces_n = [grasped(capsys, "--extra-mm", extra)["truth"]["force_n"] for extra in ("0", "0.5")]
    assert forces_n[1] > 1.2 * forces_n[0]


def test_recorded_paper_grasp_is_decided_again_alike(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "run.mcap"
    live = grasped(capsys, "--cutoff", "1.5", "--record", str(file))
    again = document(capsys, "replay", str(file))
    for name in ("outcome", "settled_percent", "size_mm", "force_n", "moments", "frames"):
        assert again[name] == live[name]


def test_the_papers_own_grasp_is_read_alike_as_the_hand_moved(
    tmp_path: Path, capsys: Capture
) -> None:
    """Steps of 1 mm end within a frame, so that no frame sees the hand move."""
    file = tmp_path / "run.mcap"
    live = grasped(capsys, "--extra-mm", "0.5", "--record", str(file))
    read = document(capsys, "replay", str(file), "--method", "paper")
    assert read["size_mm"]["value"] == pytest.approx(live["size_mm"]["value"], abs=0.1)
    settled = live["settled_percent"]["value"]
    assert read["settled_percent"]["value"] == pytest.approx(settled, rel=0.1)


def test_any_recorded_grasp_is_read_by_the_papers_method(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "run.mcap"
    assert palpate("grasp", "--seed", "3", "--record", str(file)) == 0
    capsys.readouterr()
    read = ["replay", str(file), "--method", "paper"]
    found = document(capsys, *read, "--cutoff", "1.2")
    assert found["outcome"] == "held"
    assert found["settled_percent"]["value"] < -10.0
    short = document(capsys, *read, "--cutoff", "30")
    assert short["settled_percent"] is None
    assert "never stood still for 30 s" in short["faults"][0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--step-mm", "2"], "--step-mm: only with --method paper"),
        (["--method", "paper", "--step-mm", "0"], "step_mm must be above 0"),
        (["--method", "paper", "--epsilon", "10"], "between -100 and 0"),
        (["--method", "paper", "--cutoff", "nan"], "cutoff_s must be"),
        (["--method", "paper", "--target-force-n", "3"], "neither --target-force-n"),
        (["--method", "paper", "--rig", "sim-soft", "--extra-mm", "1"], "driven by pressure"),
    ],
)
def test_impossible_option_is_refused(options: list[str], words: str, capsys: Capture) -> None:
    assert palpate("grasp", *options) == 2
    assert words in capsys.readouterr().err


def test_line_law_is_kept_in_the_calibration(tmp_path: Path, capsys: Capture) -> None:
    out = str(tmp_path / "pad.json")
    found = document(
        capsys, "calibrate", "force", "--rig", "sim-rigid", "--law", "line", "--out", out
    )
    assert found["force_law"]["law"] == "line"
    assert found["force_law"]["coefficients"][0] < 0
    assert found["expected_error_of"] == "settled force by the line"


def test_broken_settings_of_a_recording_are_refused() -> None:
    with pytest.raises(RecordingError, match="settings of the paper's method"):
        Paper.from_text('{"step_mm": -1}')
