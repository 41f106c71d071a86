"""What a recording says of the rig that it is of."""

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


def test_a_simulated_rig_gives_its_seed_and_no_time_of_day() -> None:
    rig = open_rig("sim-rigid", seed=3)
    info = recording_info(rig, seed=3)
    assert (info.origin, info.rig, info.seed, info.clock_zero_unix_ns) == (
        "twin",
        "sim-rigid",
        3,
        0,
    )
    assert info.calibration == rig.calibration.as_text()


def test_a_real_rig_gives_the_time_of_day_and_no_seed() -> None:
    rig = replace(open_rig("sim-rigid", seed=3), origin="hardware")
    info = recording_info(rig, seed=3)
    assert info.seed is None
    now_ns = info.clock_zero_unix_ns + time.monotonic_ns()
    assert abs(now_ns - time.time_ns()) < 1e9


def test_of_a_grasp_it_keeps_what_a_replay_needs_to_decide_again(tmp_path: Path) -> None:
    rig = open_rig("sim-soft", seed=3)
    file = tmp_path / "grasp.mcap"
    plan = plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=4.0)
    with record_grasp(file, rig=rig, plan=plan, damage=None) as recorder:
        frame = rig.array.read(timeout_s=1.0)
        recorder(Observation(frame=frame, gripper=rig.gripper.state()))
    info = load_recording(file).info
    assert info.gripper == rig.gripper.limits
    assert info.target_force_n == 4.0
    # What is only watched has neither: a replay would have nothing to decide.
    assert recording_info(rig, seed=3).gripper is None


def test_an_array_without_a_board_has_no_firmware() -> None:
    assert firmware_version(open_rig("sim-rigid", seed=3).array) is None
