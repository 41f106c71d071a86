"""`palpate grasp` on the twin."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.recording import load_recording

#: The rate of the paper's board: a simulated grasp then costs a third.
SLOW = ("--rate-hz", "15")


@pytest.mark.slow
def test_grasp_is_recorded_reproducible_and_labelled_simulated(
    palpate: Command, tmp_path: Path
) -> None:
    path = tmp_path / "grasp.mcap"
    options = ("--seed", "2", "--object", "springs-4", *SLOW)
    document = palpate("grasp", *options, "--record", path, "--json").document
    assert document["outcome"] == "held"
    assert document["simulated"] is True
    for name in ("settled_percent", "size_mm", "force_n", "stiffness_n_per_mm"):
        ends = [document[name]["low"], document[name]["value"], document[name]["high"]]
        known = [end for end in ends if end is not None]
        assert known == sorted(known)
        assert (document[name]["value"] is None) == (document[name]["reason"] is not None)
        assert isinstance(document["truth"][name], float)
    recording = load_recording(path)
    assert recording.info.origin == "twin"
    assert '"palpate-calibration"' in (recording.info.calibration or "")
    card = palpate("grasp", *options).out
    assert "SIMULATED" in card
    assert "springs-4" in card
    assert f"{len(recording.time_s)} frames" in card
    assert f"{document['force_n']['value']:.2f}"[:3] in card


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "options"),
    [("sim-rigid", ["--target-force-n", "2.5"]), ("sim-soft", ["--expect-size", "40"])],
)
def test_replay_reproduces_the_grasp_result(
    palpate: Command, tmp_path: Path, rig: str, options: list[str]
) -> None:
    path = tmp_path / "grasp.mcap"
    arguments = ["--rig", rig, "--seed", "1", "--rate-hz", "50", *options]
    live = palpate("grasp", *arguments, "--record", path, "--json").document
    again = palpate("replay", path, "--json").document
    assert {name: again[name] for name in again.keys() & live.keys()} == {
        name: live[name] for name in again.keys() & live.keys()
    }
    assert again["force_n"] is not None


@pytest.mark.slow
def test_grasp_expected_size_shortens_the_approach(palpate: Command) -> None:
    contact_s = list[float]()
    for options in ([], ["--expect-size", "36"]):
        moments = palpate(
            "grasp", "--object", "strawberry", "--seed", "3", *SLOW, *options, "--json"
        ).document["moments"]
        contact_s.append(next(m["time_s"] for m in moments if m["name"] == "contact"))
    assert contact_s[1] < contact_s[0] - 0.2


@pytest.mark.slow
def test_grasp_with_soft_fingers_reports_no_size_and_a_stiffness_bound(palpate: Command) -> None:
    document = palpate("grasp", "--rig", "sim-soft", "--seed", "1", *SLOW, "--json").document
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


def test_default_rig_is_that_of_the_folder_before_that_of_the_environment(
    tmp_path: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PALPATE_RIG", "nowhere")
    assert "no rig 'nowhere'" in palpate.refused("grasp")
    (tmp_path / "rig.toml").write_text('use = "sim-elsewhere"\n')
    assert "no rig 'sim-elsewhere'" in palpate.refused("grasp")


def test_target_below_what_a_calibration_can_tell_is_refused(palpate: Command) -> None:
    refused = palpate("grasp", "--seed", "1", *SLOW, "--target-force-n", "0.05", status=2)
    assert "must be at least 0.15 N, the smallest force" in refused.err
