"""What a recording holds, counted in one pass."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.gripper.interface import GripperState
from palpate.recording.contents import Event, LoadCells
from palpate.recording.reader import FileState, RecordingReader
from palpate.sensor.array import Frame


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Counts of a recording; `rate_hz` is None with fewer than two frames.

    `frames_lost` counts the gaps in the numbering; `duration_s` is from first to last frame.
    """

    frames: int
    frames_lost: int
    duration_s: float
    rate_hz: float | None
    gripper_states: int
    events: int
    load_cell_readings: int


def summarise(reader: RecordingReader, *, state: FileState) -> Summary:
    """Count what a recording holds.

    Parameters
    ----------
    reader : RecordingReader
        An open recording.
    state : FileState
        Filled in: whether the file is whole.
    """
    counts = {Frame: 0, GripperState: 0, Event: 0, LoadCells: 0}
    first: Frame | None = None
    last: Frame | None = None
    lost = 0
    for message in reader.messages(state=state):
        counts[type(message)] += 1
        if isinstance(message, Frame):
            lost += 0 if last is None else max(0, message.sequence - last.sequence - 1)
            first, last = first or message, message
    duration_s = 0.0 if first is None or last is None else last.time_s - first.time_s
    return Summary(
        frames=counts[Frame],
        frames_lost=lost,
        duration_s=duration_s,
        rate_hz=(counts[Frame] - 1) / duration_s if duration_s > 0 else None,
        gripper_states=counts[GripperState],
        events=counts[Event],
        load_cell_readings=counts[LoadCells],
    )
