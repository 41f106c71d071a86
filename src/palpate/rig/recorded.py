"""Recording of a rig, with a description of its origin."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from palpate.errors import DeviceError, RecordingLostError
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult, Outcome
from palpate.recording import Event, RecordingInfo, RecordingWriter
from palpate.rig import Rig
from palpate.rig.sensor_only import SensorRig
from palpate.sensor.array import PressureArray
from palpate.sensor.serial_array import SerialArray
from palpate.version import __version__


class GraspRecorder:
    """A subscriber of `run_grasp` that writes every observation to a recording.

    `run_grasp` removes it after an error, and the grasp continues without a recording.
    `record_grasp` raises the error at its end.
    """

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self.__name__ = "recorder"
        #: The error that ended the recording early.
        self.failure: RecordingLostError | None = None

    def __call__(self, observation: Observation) -> None:
        """Write a frame with the gripper's state."""
        try:
            self._writer.add_observation(observation.frame, gripper=observation.gripper)
        except RecordingLostError as error:
            self.failure = error
            raise

    def end(self, result: GraspResult, requests: Requests) -> None:
        """Write the time of the release or stop for a replay; `requests`: those to the grasp."""
        stopped = "stop" if requests.stop.is_set() else "release"
        names = {Outcome.HELD: "release", Outcome.STOPPED: stopped}
        name = names.get(result.outcome)
        at_s = [one.time_s for one in result.moments if one.name == result.outcome.value]
        # A grasp stopped before its first frame has no time.
        if self.failure is None and name is not None and result.frames and at_s:
            self._writer.add(Event(time_s=at_s[-1], name=name))


@contextmanager
def record_grasp(
    path: Path, *, rig: Rig, plan: Plan, damage: str | None
) -> Iterator[GraspRecorder]:
    """Yield a recorder of one grasp to a new file.

    The file contains all inputs that a replay needs to repeat the decisions.

    `damage`: text of the plan's damage file.
    Raises `RecordingError` if the file exists or can't be created; `RecordingLostError` at the end
    of the block if it could not be written whole; `DeviceError` if the board is lost.
    """
    info = replace(
        recording_info(rig, seed=rig.seed or 0),
        gripper=rig.gripper.limits,
        target_force_n=plan.target_force_n,
        expect_size_mm=plan.expect_size_mm,
        tighten=plan.tighten,
        damage=damage,
        kind=plan.kind,
        paper=None if plan.paper is None else plan.paper.as_text(),
    )
    with RecordingWriter(path, info=info) as writer:
        recorder = GraspRecorder(writer)
        yield recorder
    if recorder.failure is not None:
        raise recorder.failure


def recording_info(rig: Rig | SensorRig, *, seed: int) -> RecordingInfo:
    """Return the description of a rig for a recording without a grasp.

    `seed` is stored only for simulated rigs.

    Raises `DeviceError` if the board is lost.
    """
    return RecordingInfo(
        layout=rig.array.layout,
        origin=rig.origin,
        rig=rig.name,
        firmware_version=firmware_version(rig.array),
        calibration=None if rig.calibration is None else rig.calibration.as_text(),
        seed=seed if rig.is_simulated else None,
        versions={"palpate": __version__},
        clock_zero_unix_ns=0 if rig.is_simulated else clock_zero_unix_ns(),
    )


def clock_zero_unix_ns() -> int:
    """Return the Unix time, nanoseconds, at which this process's monotonic clock read 0."""
    return time.time_ns() - time.monotonic_ns()


def firmware_version(array: PressureArray) -> str | None:
    """Return the firmware version reported by the board, None without a board.

    Raises `DeviceError` if the board is lost.
    """
    if not isinstance(array, SerialArray):
        return None
    if array.identity is None:
        raise DeviceError(
            "the board was unplugged before the recording began; connect it and start again"
        )
    return ".".join(map(str, array.identity.version))
