"""Recording from a sensor and replay: the frames, states and timeouts of the live sensor."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.recordings import INFO, MESSAGES, write_recording

from palpate.clock import ManualClock
from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.gripper.interface import GripperState
from palpate.recording import LoadCells, RecordingWriter, Replay, load_recording
from palpate.recording.writer import record_frames
from palpate.sensor.array import RIGID_LAYOUT, Frame


def test_replay_yields_recorded_frames_states_and_times(recorded: Path) -> None:
    clock = ManualClock()
    replay = Replay(recorded, clock=clock)
    live = list(zip(MESSAGES[0:400:2], MESSAGES[1:400:2], strict=True))
    for state, frame in live:
        assert repr(replay.read(timeout_s=0.1)) == repr(frame)
        assert repr(replay.gripper_state) == repr(state)
        assert clock.now_s() == pytest.approx(frame.time_s)
    assert replay.layout == RIGID_LAYOUT
    with pytest.raises(DeviceError, match="has ended"):
        replay.read(timeout_s=0.1)
    replay.close()
    replay.close()


def test_replay_gap_raises_timeout_as_live_sensor(tmp_path: Path) -> None:
    path = tmp_path / "gap.mcap"
    with RecordingWriter(path, info=INFO) as writer:
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


@pytest.fixture
def sensed(tmp_path: Path) -> Path:
    """Frames at 10 Hz, with none between 1.0 and 4.0 s."""
    return write_recording(
        tmp_path / "sensed.mcap",
        (
            Frame(time_s=k / 10, sequence=k, counts=np.full((4, 2), k))
            for k in [*range(11), *range(40, 60)]
        ),
    )


def test_record_frames_stores_all_frames_and_silence_events(sensed: Path, tmp_path: Path) -> None:
    clock, reports = ManualClock(), list[str]()
    array = Replay(sensed, clock=clock)
    with RecordingWriter(tmp_path / "captured.mcap", info=INFO) as writer:
        cells = LoadCells(time_s=5.0, raw=(1, 2))
        count = record_frames(
            array,
            writer=writer,
            clock=clock,
            duration_s=5.85,
            load_cells=lambda: cells,
            report=reports.append,
        )
    array.close()
    captured, was = load_recording(tmp_path / "captured.mcap"), load_recording(sensed)
    assert count == 30
    assert np.array_equal(captured.counts, was.counts[:30])
    assert captured.time_s.tolist() == was.time_s[:30].tolist()
    assert [event.name for event in captured.events] == ["silent", "back"]
    assert [event.time_s for event in captured.events] == pytest.approx([2.0, 4.0])
    assert captured.load_cells == (cells,) * 30
    assert reports[1] == "frames are arriving again"


@pytest.mark.parametrize(
    ("duration_s", "error", "message", "count"),
    [
        (3.5, DeviceTimeoutError, "silent at the end: 11 frames were recorded", 11),
        (math.inf, DeviceError, "has ended", 31),
    ],
    ids=["silent", "lost"],
)
def test_record_frames_of_a_silent_or_lost_sensor_preserves_recorded_frames(
    sensed: Path,
    tmp_path: Path,
    duration_s: float,
    error: type[DeviceError],
    message: str,
    count: int,
) -> None:
    clock = ManualClock()
    array = Replay(sensed, clock=clock)
    with (
        pytest.raises(error, match=message),
        RecordingWriter(tmp_path / "captured.mcap", info=INFO) as writer,
    ):
        record_frames(array, writer=writer, clock=clock, duration_s=duration_s)
    array.close()
    assert len(load_recording(tmp_path / "captured.mcap").time_s) == count
