"""A replay of a recorded grasp ends as the grasp did."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.clock import ManualClock
from palpate.errors import RecordingError
from palpate.grasp.phases import Phase
from palpate.grasp.replay_grasp import replay_grasp
from palpate.grasp.state import GraspState
from palpate.recording import (
    RecordingInfo,
    RecordingWriter,
    Replay,
    ReplayGripper,
    load_recording,
)
from palpate.rig import open_rig
from palpate.rig.job import GraspJob
from palpate.sensor.array import RIGID_LAYOUT


@pytest.mark.parametrize(
    ("request_in", "name", "outcome"),
    [
        (Phase.HOLD, "release", "held"),
        (Phase.SQUEEZE, "release", "stopped"),
        (Phase.SQUEEZE, "stop", "stopped"),
    ],
)
def test_replay_of_a_grasp_ended_by_the_user_ends_at_the_same_frame(
    tmp_path: Path, request_in: Phase, name: str, outcome: str
) -> None:
    file = tmp_path / "run.mcap"
    rig = open_rig("sim-rigid", seed=3, rate_hz=50.0)
    job = GraspJob(rig, target_force_n=2.0, hold_s=60.0, record=file)
    seen_in: list[float] = []

    def send_request(state: GraspState) -> None:
        if state.phase is request_in:
            seen_in.append(state.estimate.now_s)
        if seen_in and state.estimate.now_s > seen_in[0] + 2.0 * (request_in is Phase.HOLD):
            getattr(job.requests, name).set()

    with job:
        result = job.run(watchers=[send_request])
    assert result.outcome == outcome
    clock = ManualClock(load_recording(file).time_s[0])
    source = Replay(file, clock=clock)
    assert replay_grasp(source, clock=clock) == result
    source.close()


def test_replay_of_a_recording_without_a_gripper_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    with RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="hardware")):
        pass
    source = Replay(path, clock=ManualClock())
    with pytest.raises(RecordingError, match="not the recording of a grasp"):
        ReplayGripper(source)
    source.close()
