"""`palpate grasp` on the twin."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.recording import load_recording

pytestmark = pytest.mark.slow


def test_grasp_json_is_one_document_and_reproducible(palpate: Command) -> None:
    first = palpate("grasp", "--seed", "1", "--json").out
    assert palpate("grasp", "--seed", "1", "--json").out == first
    document = json.loads(first)
    assert document["outcome"] == "held"
    assert document["simulated"] is True
    for name in ("settled_percent", "size_mm", "force_n", "stiffness_n_per_mm"):
        assert set(document[name]) == {"value", "low", "high", "status", "unit", "level", "reason"}
        ends = [document[name]["low"], document[name]["value"], document[name]["high"]]
        known = [end for end in ends if end is not None]
        assert known == sorted(known)
        assert (document[name]["value"] is None) == (document[name]["reason"] is not None)
        assert isinstance(document["truth"][name], float)
    assert document["truth"]["damaged"] is False
    assert {"peak_force_n", "frames", "frames_lost", "verdict", "decision_time_s"} <= set(document)


def test_grasp_card_is_labelled_simulated_and_every_frame_recorded(
    palpate: Command, tmp_path: Path
) -> None:
    path = tmp_path / "grasp.mcap"
    card = palpate("grasp", "--seed", "2", "--object", "springs-4", "--record", path).out
    assert "SIMULATED" in card
    assert "springs-4" in card
    recording = load_recording(path)
    assert recording.info.origin == "twin"
    assert f"{len(recording.time_s)} frames" in card
    assert '"palpate-calibration"' in (recording.info.calibration or "")


def test_grasp_card_reports_damaged_object_in_red(
    palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    options = ["--object", "strawberry", "--seed", "3", "--target-force-n"]
    card = palpate("grasp", *options, "14").out
    lines = [line for line in card.splitlines() if "Held" in line or "damaged" in line]
    assert "damaged" in lines[1]
    assert "\x1b[1;31mHeld" in lines[0]
    assert "\x1b[1;31mThe object was damaged" in lines[1]
    assert card.startswith("\x1b[31m╭")
    assert palpate("grasp", *options, "2").out.startswith("\x1b[32m╭")


@pytest.mark.parametrize("rig", ["sim-rigid", "sim-soft"])
@pytest.mark.parametrize("options", [["--target-force-n", "2.5"], ["--expect-size", "40"]])
def test_replay_reproduces_the_grasp_result(
    palpate: Command, tmp_path: Path, rig: str, options: list[str]
) -> None:
    path = tmp_path / "grasp.mcap"
    arguments = ["--rig", rig, "--seed", "1", *options]
    live = palpate("grasp", *arguments, "--record", path, "--json").document
    again = palpate("replay", path, "--json").document
    assert {name: again[name] for name in again.keys() & live.keys()} == {
        name: live[name] for name in again.keys() & live.keys()
    }
    assert again["force_n"] is not None


def test_grasp_expected_size_shortens_the_approach(palpate: Command) -> None:
    contact_s = list[float]()
    for options in ([], ["--expect-size", "36"]):
        moments = palpate(
            "grasp", "--object", "strawberry", "--seed", "3", *options, "--json"
        ).document["moments"]
        contact_s.append(next(m["time_s"] for m in moments if m["name"] == "contact"))
    assert contact_s[1] < contact_s[0] - 0.3


def test_grasp_with_soft_fingers_reports_no_size_and_a_stiffness_bound(palpate: Command) -> None:
    document = palpate("grasp", "--rig", "sim-soft", "--seed", "1", "--json").document
    assert document["outcome"] == "held"
    assert document["size_mm"] is document["previous_width_mm"] is None
    stiffness = document["stiffness_n_per_mm"]
    assert stiffness["status"] == "at_least"
    assert stiffness["value"] is stiffness["high"] is None
    true = document["truth"]["stiffness_n_per_mm"]
    assert stiffness["low"] <= true
    # The firmness has a value even if only a bound of the stiffness is known.
    firmness = document["firmness"]
    assert 0 <= firmness["low"] <= firmness["value"] <= firmness["high"] <= 100
    assert firmness["low"] <= 100 * math.log10(true / 0.1) / 3 <= firmness["high"]
    for name in ("settled_percent", "force_n"):
        assert document[name]["low"] <= document["truth"][name] <= document[name]["high"]


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--object", "brick"], 2, "no simulated object 'brick'; available: ecoflex-10"),
        (["--rig", "nowhere"], 2, "no rig 'nowhere'; available: sim-rigid, sim-soft"),
        (["--rig", "nowhere.toml"], 2, "rig file nowhere.toml: no such file"),
        (["--rig", "sim-soft", "--object", "brick"], 2, "no simulated object 'brick'"),
        (["--target-force-n", "900"], 2, "force ceiling"),
        (["--target-force-n", "nan"], 2, "must be above 0"),
    ],
)
def test_grasp_invalid_input_is_refused_in_one_line(
    palpate: Command, arguments: list[str], status: int, message: str
) -> None:
    assert message in palpate.refused("grasp", *arguments, status=status)
