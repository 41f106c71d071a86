"""A small recording with every type of message."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from palpate.gripper.interface import GripperState
from palpate.recording import Event, LoadCells, RecordingInfo, RecordingWriter
from palpate.recording.channels import RecordedMessage
from palpate.sensor.array import RIGID_LAYOUT, Frame

INFO = RecordingInfo(
    layout=RIGID_LAYOUT,
    origin="twin",
    rig="sim-rigid",
    firmware_version="1.2.3",
    calibration="[rest]\nresistance_ohm = 1",
    seed=7,
    versions={"palpate": "0.1.0"},
)


def make_messages() -> list[RecordedMessage]:
    """Return 50 frames/s: closing (1 s), a hold (2 s), opening (1 s)."""
    rng = np.random.default_rng(0)
    made: list[RecordedMessage] = []
    for k in range(200):
        moving = k < 50 or k >= 150
        made.append(GripperState(time_s=k / 50, width_mm=60.0 - k / 10, moving=moving))
        counts = 300 + rng.integers(0, 5, (4, 2)) + (200 if 25 <= k < 175 else 0)
        made.append(Frame(time_s=k / 50, sequence=k + (k >= 100), counts=counts, oversampling=1))
    made.append(Event(time_s=4.0, name="note", text="ripe — by eye"))
    made.append(LoadCells(time_s=4.0, raw=(-12, 8_388_607), force_n=(0.1, 2.5)))
    return made


MESSAGES = make_messages()


def write_recording(
    path: Path, messages: Iterable[RecordedMessage], info: RecordingInfo = INFO
) -> Path:
    with RecordingWriter(path, info=info) as writer:
        for message in messages:
            writer.add(message)
    return path
