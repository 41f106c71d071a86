"""The paper's method on the twin: contact by mean, size, settled value, force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.commands import Command
from tests.conftest import skip

from palpate.errors import RecordingError
from palpate.grasp.paper import Paper
from palpate.twin.firmware import BUILD

pytestmark = pytest.mark.slow


def grasped(palpate: Command, *options: object) -> dict[str, Any]:
    message = ("grasp", "--method", "paper", "--seed", "3", *options, "--json")
    document: dict[str, Any] = palpate(*message).document
    return document


def test_paper_method_on_rigid_fingers_measures_size_and_force(palpate: Command) -> None:
    found = grasped(palpate, "--object", "strawberry")
    assert found["outcome"] == "held"
    assert found["decision_time_s"] == pytest.approx(2.5, abs=0.2)
    size, truth = found["size_mm"], found["truth"]
    assert size["value"] == pytest.approx(truth["size_mm"], abs=2.0)
    assert size["value"] - size["low"] == pytest.approx(1.0, abs=0.06)
    assert found["force_n"] is not None
    assert found["stiffness_n_per_mm"] is None


def test_paper_method_on_pressure_driven_fingers_has_no_size(palpate: Command) -> None:
    found = grasped(palpate, "--rig", "sim-soft")
    assert (found["outcome"], found["size_mm"], found["previous_width_mm"]) == ("held", None, None)


@pytest.mark.system
def test_paper_method_with_the_firmware_on_a_simulated_board_holds_the_object(
    palpate: Command,
) -> None:
    if not (BUILD / "libpalpate_board.so").exists():
        skip("no firmware simulator: `make -C firmware/sim` builds it")
    found = grasped(palpate, "--rig", "sim-firmware", "--object", "strawberry")
    assert found["outcome"] == "held"
    assert found["size_mm"]["value"] == pytest.approx(found["truth"]["size_mm"], abs=2.0)


def test_paper_method_extra_closing_increases_force(palpate: Command) -> None:
    forces_n = [grasped(palpate, "--extra-mm", extra)["truth"]["force_n"] for extra in ("0", "0.5")]
    assert forces_n[1] > 1.2 * forces_n[0]


def test_paper_method_peak_force_includes_the_extra_closing(palpate: Command) -> None:
    found = grasped(palpate, "--extra-mm", "0.5")
    assert found["peak_force_n"] >= found["force_n"]["value"]


def test_replay_grasp_repeats_recorded_paper_grasp(tmp_path: Path, palpate: Command) -> None:
    file = tmp_path / "run.mcap"
    live = grasped(palpate, "--cutoff", "1.5", "--record", file)
    again = palpate("replay", file, "--json").document
    for name in ("outcome", "settled_percent", "size_mm", "force_n", "moments", "frames"):
        assert again[name] == live[name]


def test_evaluate_with_paper_method_matches_its_own_grasp(tmp_path: Path, palpate: Command) -> None:
    """Steps of 1 mm end within a frame, so no frame shows movement."""
    file = tmp_path / "run.mcap"
    live = grasped(palpate, "--extra-mm", "0.5", "--record", file)
    read = palpate("replay", file, "--method", "paper", "--json").document
    assert read["size_mm"]["value"] == pytest.approx(live["size_mm"]["value"], abs=0.1)
    settled = live["settled_percent"]["value"]
    assert read["settled_percent"]["value"] == pytest.approx(settled, rel=0.1)


def test_evaluate_with_paper_method_accepts_any_recorded_grasp(
    tmp_path: Path, palpate: Command
) -> None:
    file = tmp_path / "run.mcap"
    palpate("grasp", "--seed", "3", "--record", file)
    read = ["replay", file, "--method", "paper"]
    found = palpate(*read, "--cutoff", "1.2", "--json").document
    assert found["outcome"] == "held"
    assert found["settled_percent"]["value"] < -10.0
    short = palpate(*read, "--cutoff", "30", "--json").document
    assert short["settled_percent"] is None
    assert (short["outcome"], short["peak_force_n"]) == ("held", None)
    assert "never stationary for 30 s" in short["faults"][0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--step-mm", "2"], "--step-mm: valid only with --method paper"),
        (["--method", "paper", "--step-mm", "0"], "--step-mm must be above 0"),
        (["--method", "paper", "--epsilon", "10"], "between -100 and 0"),
        (["--method", "paper", "--cutoff", "nan"], "--cutoff must be"),
        (["--method", "paper", "--target-force-n", "3"], "combined with --target-force-n"),
        (["--method", "paper", "--rig", "sim-soft", "--extra-mm", "1"], "pressure-driven"),
    ],
)
def test_paper_setting_out_of_range_is_refused(
    options: list[str], message: str, palpate: Command
) -> None:
    assert message in palpate.refused("grasp", *options)


def test_with_line_law_stores_law_in_calibration(tmp_path: Path, palpate: Command) -> None:
    out = tmp_path / "pad.json"
    found = palpate(
        "calibrate", "force", "--rig", "sim-rigid", "--law", "line", "--out", out, "--json"
    ).document
    assert found["force_law"]["law"] == "line"
    assert found["force_law"]["coefficients"][0] < 0
    assert found["expected_error_of"] == "settled force by the line"


def test_paper_from_text_invalid_settings_are_refused() -> None:
    with pytest.raises(RecordingError, match="settings of the paper's method"):
        Paper.from_text('{"step_mm": -1}')
