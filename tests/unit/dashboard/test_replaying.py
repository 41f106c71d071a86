"""Replay on the page: a damaged recording is named to the reader of the page."""

from __future__ import annotations

from pathlib import Path
from threading import Event

import numpy as np
import pytest

from palpate.dashboard.messages import Trouble
from palpate.dashboard.replaying import PlaybackClock, play
from palpate.dashboard.telemetry import Telemetry
from palpate.errors import DamageWarning
from palpate.grasp.requests import Requests
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.sensor.array import RIGID_LAYOUT, Frame


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    file = tmp_path / "run.mcap"
    info = RecordingInfo(layout=RIGID_LAYOUT, origin="twin")
    with RecordingWriter(file, info=info) as writer:
        for k in range(300):
            counts = np.full((4, 2), 300 + k % 7, dtype=np.int32)
            writer.add(Frame(time_s=k / 50, sequence=k, counts=counts))
    return file


def replay_notes(file: Path) -> list[str]:
    """Return the troubles that the page shows while it replays a file."""
    telemetry, requests = Telemetry(lambda update: None, on_lost=lambda: None), Requests()
    requests.stop.set()
    play(
        file,
        telemetry=telemetry,
        requests=requests,
        confirmed=Event(),
        playback=PlaybackClock(speed=1.0, now_s=lambda: 0.0),
    )
    return [note.text for note in telemetry.update().notes if isinstance(note, Trouble)]


def test_replay_of_an_intact_recording_has_no_trouble(recorded: Path) -> None:
    assert replay_notes(recorded) == []


def test_replay_of_a_truncated_recording_says_so_on_the_page(recorded: Path) -> None:
    recorded.write_bytes(recorded.read_bytes()[:-60])
    with pytest.warns(DamageWarning):
        [trouble] = replay_notes(recorded)
    assert trouble.startswith("run.mcap: not finished")
