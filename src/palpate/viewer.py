"""What a viewer shows of a running or recorded sensor: one interface for all of them.

`palpate live` shows a running sensor, `show_recording` a file. A viewer's package only writes the
values in the viewer's format; entry points of the group ``palpate.viewers`` name them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from palpate.arrays import FloatArray
from palpate.calibration import Calibration
from palpate.clock import ManualClock
from palpate.errors import RecordingError
from palpate.force.of_calibration import force_now
from palpate.grasp.phases import Phase
from palpate.grasp.replay_grasp import replay_grasp
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement
from palpate.recording import Event, Recording, RecordingReader, Replay, load_recording
from palpate.recording.channels import RecordedMessage
from palpate.recording.exporting import measure_rest_ohm, solve_resistance_ohm
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.sample import SampleReader

#: Entry-point group of the viewers.
GROUP = "palpate.viewers"


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """Source of the frames and quality of the link."""

    time_s: float
    #: Name of the rig or port.
    source: str
    simulated: bool
    #: Recent frame rate; NaN before the second frame.
    rate_hz: float
    #: Counts since the start: received frames, lost frames, corrupt packets.
    frames: int
    lost: int
    corrupt: int


class Viewer(Protocol):
    """Receives the values of one sensor in the order of time."""

    @property
    def description(self) -> str:
        """The viewer's name and address, for the user."""
        ...

    def send_recorded(self, message: RecordedMessage) -> None:
        """Show a message of a recording: frame, gripper state, event or load cell reading."""
        ...

    def send_change(self, time_s: float, change_percent: FloatArray) -> None:
        """Show relative changes, shape (rows, cols), NaN for a pixel without a reading."""
        ...

    def send_force(self, time_s: float, force_n: Measurement) -> None:
        """Show the force with its interval."""
        ...

    def send_link(self, link: Link) -> None:
        """Show the source of the frames and the state of the link."""
        ...

    def close(self) -> None:
        """Send what is still waiting, and release the viewer."""
        ...


def pixel_names(layout: ArrayLayout) -> list[str]:
    """Return the pixels' names as in an exported table, row by row.

    >>> pixel_names(ArrayLayout(name="pad", rows=1, cols=2, finger_of_row=(0,)))
    ['r0c0', 'r0c1']
    """
    return [f"r{row}c{col}" for row in range(layout.rows) for col in range(layout.cols)]


def show_recording(path: Path, viewer: Viewer) -> Recording:
    """Send a recording to a viewer: messages, changes, forces, and the phases of a grasp.

    Changes are relative to the rest at the beginning of the file. With the recording's calibration,
    the force is estimated from frames alone, as by ``palpate live --force``. Contacts and phases
    of a recorded grasp are those of its replay.

    Returns the recording. Raises `RecordingError` if the file can't be read, has no rest at its
    beginning, or has the calibration of another sensor; `CalibrationError` if that calibration
    can't be read.
    """
    recording = load_recording(path)
    info = recording.info
    if recording.time_s.size == 0:
        raise RecordingError(f"{path}: no frames to show")
    try:
        rest_ohm = measure_rest_ohm(recording, solve_resistance_ohm(recording))
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    force = None
    if info.calibration is not None:
        calibration = Calibration.from_text(info.calibration, where=str(path))
        if difference := calibration.layout.describe_difference(info.layout):
            raise RecordingError(f"{path}: its calibration is of another sensor ({difference})")
        force = force_now(calibration)
    samples = SampleReader(info.layout, rest_ohm)
    with RecordingReader(path) as reader:
        for message in reader.readable_messages():
            viewer.send_recorded(message)
            if not isinstance(message, Frame):
                continue
            sample = samples.read(message)
            viewer.send_change(sample.time_s, sample.change_percent)
            if force is not None:
                force_n = force.step(
                    *(sample.time_s, sample.excess),
                    saturated=sample.has_saturated,
                    lost=sample.has_lost,
                )
                viewer.send_force(sample.time_s, force_n)
    if info.gripper is not None and info.calibration is not None:
        for event in _replay_events(path, start_s=float(recording.time_s[0])):
            viewer.send_recorded(event)
    return recording


def _replay_events(path: Path, *, start_s: float) -> list[Event]:
    """Return contacts, answers and phases of a recorded grasp, in the order of time."""
    events: list[Event] = []
    phases: list[Phase] = []

    def note_phase(state: GraspState) -> None:
        if not phases or state.phase is not phases[-1]:
            phases.append(state.phase)
            now_s = state.estimate.now_s
            events.append(Event(time_s=now_s, name="phase", text=state.phase.value))

    clock = ManualClock(start_s)
    source = Replay(path, clock=clock)
    try:
        result = replay_grasp(source, clock=clock, watchers=[note_phase])
    finally:
        source.close()
    for moment in result.moments:
        finger = "" if moment.finger is None else f"finger {moment.finger}"
        events.append(Event(time_s=moment.time_s, name=moment.name, text=finger))
    return sorted(events, key=lambda event: event.time_s)
