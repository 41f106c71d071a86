"""The description of a rig in a recording."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from palpate.rig import Rig, open_rig
from palpate.rig.recorded import firmware_version, recording_info


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
