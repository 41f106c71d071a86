"""A recorded grasp, run through the controller again, gives what the live one gave."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.cli import build_app, run
from palpate.clock import ManualClock
from palpate.errors import RecordingError
from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.recording import (
    RecordingInfo,
    RecordingWriter,
    Replay,
    ReplayGripper,
    load_recording,
)
from palpate.recording.exporting import cut_recorded_holds
from palpate.rig import open_rig


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, GraspResult]:
    """Grasp on the twin, recorded."""
    path = tmp_path_factory.mktemp("grasp") / "live.mcap"
    rig = open_rig("sim-rigid", object_name=None, seed=1)
    info = RecordingInfo(
        layout=rig.array.layout,
        origin="twin",
        calibration=rig.calibration.as_text(),
        gripper=rig.gripper.limits,
        target_force_n=3.0,
        seed=1,
    )
    with RecordingWriter(path, info=info) as writer:

        def recorder(observation: Observation) -> None:
            writer.add_observation(observation.frame, gripper=observation.gripper)

        result = run_grasp(
            plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=3.0),
            array=rig.array,
            gripper=rig.gripper,
            clock=rig.clock,
            subscribers=[recorder],
        )
    rig.close()
    return path, result


def test_the_replay_decides_as_the_live_run_did(
    live: tuple[Path, GraspResult], capsys: pytest.CaptureFixture[str]
) -> None:
    path, result = live
    assert result.outcome == "held"
    assert run(build_app(), ["replay", str(path), "--json"], name="palpate") == 0
    replayed = json.loads(capsys.readouterr().out)
    assert replayed.pop("simulated") is True
    assert replayed.pop("recording") == str(path)
    assert replayed == json.loads(json.dumps(result.to_dict()))


def test_the_text_says_that_it_is_simulated(
    live: tuple[Path, GraspResult], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(build_app(), ["replay", str(live[0])], name="palpate") == 0
    assert capsys.readouterr().out.startswith("held  (SIMULATED: twin)\n")


def test_its_holds_are_cut_where_the_gripper_stood_still(live: tuple[Path, GraspResult]) -> None:
    recording = load_recording(live[0])
    holds = [hold for hold in cut_recorded_holds(recording) if hold.channel == "mean"]
    assert holds
    assert all(hold.time_s[-1] > 0.9 for hold in holds)
    assert min(hold.values.min() for hold in holds) < -10.0


def test_without_a_gripper_nothing_can_be_decided(
    live: tuple[Path, GraspResult], tmp_path: Path
) -> None:
    path = tmp_path / "bare.mcap"
    info = replace(load_recording(live[0]).info, gripper=None)
    with RecordingWriter(path, info=info):
        pass
    source = Replay(path, clock=ManualClock())
    with pytest.raises(RecordingError, match="names no gripper"):
        ReplayGripper(source)
    source.close()
