"""Replay of a recording as a sensor with the recorded frames and times."""

from __future__ import annotations

import os
from collections.abc import Iterator

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError, RecordingError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.recording.contents import Event, RecordingInfo
from palpate.recording.reader import RecordingReader
from palpate.sensor.array import ArrayLayout, Frame

#: Names of the events at the end of a recorded grasp.
_END_EVENTS = ("release", "stop")


class Replay:
    """A recording as a `PressureArray`, with the gripper states recorded with the frames.

    On a `ManualClock` that starts at the first frame, a replay runs as fast as it is read.

    `path`: an `.mcap` recording.
    `clock`: in the recording's time. A frame is returned once the clock has reached its time.
    """

    def __init__(self, path: str | os.PathLike[str], *, clock: Clock) -> None:
        self._reader = RecordingReader(path)
        self._clock = clock
        self._pairs = observations(self._reader)
        self._next: tuple[Frame, GripperState | None] | None = next(self._pairs, None)
        self._gripper: GripperState | None = None

    @property
    def info(self) -> RecordingInfo:
        """The description of the recorded rig."""
        return self._reader.info

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the recorded frames."""
        return self._reader.info.layout

    @property
    def end(self) -> Event | None:
        """The event ``release`` or ``stop`` of a recorded grasp; None if not recorded."""
        with RecordingReader(self._reader.path) as reader:
            ends = (m for m in reader.messages() if isinstance(m, Event) and m.name in _END_EVENTS)
            return next(ends, None)

    @property
    def has_ended(self) -> bool:
        """Whether every frame was read."""
        return self._next is None

    @property
    def gripper_state(self) -> GripperState | None:
        """The state recorded with the last frame read; None if not recorded."""
        return self._gripper

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next recorded frame at its recorded time.

        Raises `DeviceTimeoutError` at a gap longer than `timeout_s`, as the live sensor did;
        `DeviceError` at the end of the recording.
        """
        if self._next is None:
            raise DeviceError(f"{self._reader.path}: the recording has ended")
        frame, gripper = self._next
        wait_s = frame.time_s - self._clock.now_s()
        if wait_s > timeout_s:
            self._clock.sleep_s(timeout_s)
            raise DeviceTimeoutError(
                f"{self._reader.path}: no frame within {timeout_s:g} s at "
                f"{self._clock.now_s():.3f} s of the recording; frames were lost there"
            )
        if wait_s > 0:
            self._clock.sleep_s(wait_s)
        self._next = next(self._pairs, None)
        self._gripper = gripper
        return frame

    def close(self) -> None:
        """Close the recording; further calls have no effect."""
        self._reader.close()


class ReplayGripper:
    """The gripper of a recording, which reports the recorded states.

    Commands have no effect. Equal decisions from equal frames yield the commands that were sent
    live.

    `replay`: the recording; each state belongs to the last frame read from it.
    Raises `RecordingError` if it is not the recording of a grasp.
    """

    def __init__(self, replay: Replay) -> None:
        if replay.info.gripper is None:
            raise RecordingError(
                "not the recording of a grasp; `palpate grasp --record FILE` makes one"
            )
        self.limits: GripperLimits = replay.info.gripper
        self._replay = replay

    def state(self) -> GripperState:
        """Return the state recorded with the last frame read.

        Raises `DeviceError` if no state was recorded.
        """
        state = self._replay.gripper_state
        if state is None:
            raise DeviceError("the recording has no gripper state before this frame")
        return state

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Return the command as it would be sent, clamped to the limits."""
        return self.limits.clamp(wanted)

    def stop(self) -> None:
        """Do nothing: the recorded movement can't be stopped."""

    def release(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def observations(reader: RecordingReader) -> Iterator[tuple[Frame, GripperState | None]]:
    """Yield every frame in recorded order with the last gripper state before the frame."""
    gripper: GripperState | None = None
    for message in reader.messages():
        if isinstance(message, GripperState):
            gripper = message
        elif isinstance(message, Frame):
            yield message, gripper
