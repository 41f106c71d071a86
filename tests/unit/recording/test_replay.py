"""A replay yields the frames, states and timeouts of the live sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.clock import ManualClock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.gripper.interface import GripperState
from palpate.recording import RecordingInfo, RecordingWriter, Replay
from palpate.recording.channels import RecordedMessage
from palpate.sensor.array import RIGID_LAYOUT, Frame


def test_replay_yields_recorded_frames_states_and_times(
    recorded: Path, messages: list[RecordedMessage]
) -> None:
    clock = ManualClock()
    replay = Replay(recorded, clock=clock)
    live = list(zip(messages[0:400:2], messages[1:400:2], strict=True))
    for state, frame in live:
        assert repr(replay.read(timeout_s=0.1)) == repr(frame)
        assert repr(replay.gripper_state) == repr(state)
        assert clock.now_s() == pytest.approx(frame.time_s)
    assert replay.layout == RIGID_LAYOUT
    with pytest.raises(DeviceError, match="has ended"):
        replay.read(timeout_s=0.1)
    replay.close()
    replay.close()


def test_replay_gap_raises_timeout_as_live_sensor(tmp_path: Path, info: RecordingInfo) -> None:
    path = tmp_path / "gap.mcap"
    with RecordingWriter(path, info=info) as writer:
        for k, time_s in enumerate((0.0, 0.02, 1.0)):
            frame = Frame(time_s=time_s, sequence=k, counts=np.ones((4, 2)))
            writer.add_observation(frame, gripper=GripperState(time_s=time_s))
    clock = ManualClock()
    replay = Replay(path, clock=clock)
    replay.read(timeout_s=0.1)
    replay.read(timeout_s=0.1)
    with pytest.raises(DeviceTimeoutError, match=r"no frame within 0\.5 s at 0\.520 s"):
        replay.read(timeout_s=0.5)
    assert replay.read(timeout_s=0.5).time_s == 1.0
    replay.close()
