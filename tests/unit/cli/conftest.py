"""A rig file and recordings on the twin, for commands that read a sensor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.recording import RecordingInfo, RecordingWriter
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.sensor.frame_columns import FrameColumns
from palpate.signal.circuit import ohm_to_volts, volts_to_counts
from palpate.twin.devices import TwinArray
from palpate.twin.world import World

_OPENER = """
from palpate.twin.devices import TwinArray
from palpate.twin.world import World
from palpate.twin.objects import draw_object
import numpy as np

def open_twin(*, seed, pressed=False):
    world = World(draw_object(np.random.default_rng(1), "springs-4"), seed=seed)
    if pressed:
        world.drive(38.0, rate=20.0)
        world.clock.sleep_s(1.0)
    return TwinArray(world)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run the test in an empty folder that gets the default store."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("COLUMNS", "120")
    return tmp_path


@pytest.fixture
def rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Write rig files next to a module that opens a twin's array."""
    (tmp_path / "rig_of_a_twin.py").write_text(_OPENER)
    monkeypatch.syspath_prepend(tmp_path)

    def write(*, seed: int = 1, pressed: bool = False) -> Path:
        path = tmp_path / "rig.toml"
        path.write_text(
            'calibration = "sensor.json"\n[array]\nopen = "rig_of_a_twin:open_twin"\n'
            f"seed = {seed}\npressed = {str(pressed).lower()}\n"
        )
        return path

    return write


@pytest.fixture
def record_twin(tmp_path: Path) -> Callable[..., Path]:
    """Record ten seconds of rest, then a press on each pixel of `order`."""

    def record(*, seed: int = 1, order: list[tuple[int, int]] | None = None) -> Path:
        array = TwinArray(World(None, seed=seed))
        frames = [array.read(timeout_s=1.0) for _ in range(150)]
        rest_ohm = FrameColumns.from_frames(frames).rest_ohm(layout=RIGID_LAYOUT)
        for pixel in order or []:
            for k in range(45):
                frame = array.read(timeout_s=1.0)
                factor = np.ones((4, 2))
                factor[pixel] = 0.1 if 10 < k < 25 else 1.0
                volts = ohm_to_volts(rest_ohm * factor, divider=RIGID_LAYOUT.divider)
                counts = volts_to_counts(volts, divider=RIGID_LAYOUT.divider)
                frames.append(Frame(time_s=frame.time_s, sequence=frame.sequence, counts=counts))
        path = tmp_path / "run.mcap"
        path.unlink(missing_ok=True)
        with RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="twin")) as file:
            for frame in frames:
                file.add(frame)
        return path

    return record
