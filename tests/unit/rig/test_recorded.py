"""The description of a rig in a recording."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.recording import load_recording
from palpate.rig import open_rig
from palpate.rig.recorded import firmware_version, record_grasp, recording_info

pytestmark = pytest.mark.slow


def test_recording_info_of_simulated_rig_has_seed_and_no_unix_time() -> None:
    rig = open_rig("sim-rigid", seed=3)
    info = recording_info(rig, seed=3)
    assert (info.origin, info.rig, info.seed, info.clock_zero_unix_ns) == (
        "twin",
        "sim-rigid",
        3,
        0,
    )
    assert info.calibration == rig.calibration.as_text()


def test_recording_info_of_real_rig_has_unix_time_and_no_seed() -> None:
    rig = replace(open_rig("sim-rigid", seed=3), origin="hardware")
    info = recording_info(rig, seed=3)
    assert info.seed is None
    now_ns = info.clock_zero_unix_ns + time.monotonic_ns()
    assert abs(now_ns - time.time_ns()) < 1e9


def test_record_grasp_stores_limits_and_target_for_replay(tmp_path: Path) -> None:
    rig = open_rig("sim-soft", seed=3)
    file = tmp_path / "grasp.mcap"
    plan = plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=4.0)
    with record_grasp(file, rig=rig, plan=plan, damage=None) as recorder:
        frame = rig.array.read(timeout_s=1.0)
        recorder(Observation(frame=frame, gripper=rig.gripper.state()))
    info = load_recording(file).info
    assert info.gripper == rig.gripper.limits
    assert info.target_force_n == 4.0
    # A recording without a grasp has neither, because a replay makes no decisions.
    assert recording_info(rig, seed=3).gripper is None


def test_firmware_version_without_board_is_none() -> None:
    assert firmware_version(open_rig("sim-rigid", seed=3).array) is None
