"""The description of a rig in a recording."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.recording import load_recording
from palpate.rig import Rig, open_rig
from palpate.rig.recorded import firmware_version, record_grasp, recording_info


@pytest.fixture(scope="module")
def rig() -> Rig:
    return open_rig("sim-rigid", seed=3)


@pytest.mark.slow
def test_recording_info_has_seed_or_unix_time(rig: Rig) -> None:
    info = recording_info(rig, seed=3)
    assert (info.origin, info.rig, info.seed) == ("twin", "sim-rigid", 3)
    assert info.clock_zero_unix_ns == 0
    assert info.calibration == rig.calibration.as_text()
    # Without a grasp there are no limits, because a replay makes no decisions.
    assert info.gripper is None
    assert firmware_version(rig.array) is None
    real = recording_info(replace(rig, origin="hardware"), seed=3)
    assert real.seed is None
    now_ns = real.clock_zero_unix_ns + time.monotonic_ns()
    assert abs(now_ns - time.time_ns()) < 60e9


@pytest.mark.slow
def test_record_grasp_stores_limits_and_target_for_replay(rig: Rig, tmp_path: Path) -> None:
    file = tmp_path / "grasp.mcap"
    plan = plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=4.0)
    with record_grasp(file, rig=rig, plan=plan, damage=None) as recorder:
        frame = rig.array.read(timeout_s=1.0)
        recorder(Observation(frame=frame, gripper=rig.gripper.state()))
    info = load_recording(file).info
    assert info.gripper == rig.gripper.limits
    assert info.target_force_n == 4.0
