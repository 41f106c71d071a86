"""A recorded grasp as an episode: observations and commands on an even time grid.

A recording contains no commands. The controller recomputes them from the recorded frames, as in
`palpate replay`; the states of the hand are the recorded ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.calibration import Calibration
from palpate.clock import ManualClock
from palpate.errors import RecordingError
from palpate.force.of_calibration import force_now
from palpate.grasp.estimator import Observation
from palpate.grasp.replay_grasp import replay_grasp
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.recording import RecordingInfo, RecordingReader, Replay, ReplayGripper
from palpate.recording.replay import observations
from palpate.sensor.array import ArrayLayout
from palpate.sensor.sample import SampleReader

#: Unit of position and rate, by the gripper's drive.
_POSITION = {"width": ("width_mm", "rate_mm_per_s"), "pressure": ("pressure_kpa", "rate_kpa_per_s")}
#: Outcomes with which the recomputed commands may differ from those sent: truncated recordings, or
#: other control of the hand.
_BROKEN = (Outcome.SENSOR_LOST, Outcome.GRIPPER_FAULT)
#: Smallest ratio of the frame rate to the rate of the time grid.
_MIN_RATE_FRACTION = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspTrack:
    """A recorded grasp of n frames with recomputed commands.

    Attributes
    ----------
    path : Path
        The recording.
    info : RecordingInfo
        Description of the recording.
    outcome : str
        Outcome of the grasp.
    time_s : ndarray, shape (n,)
        Time of each frame.
    state : ndarray, shape (n, n_state)
        Columns `state_names`: position, force with its interval, change of each pixel relative to
        rest; NaN for pixels without a reading.
    action : ndarray, shape (n, 2)
        Columns `action_names`: target and speed of the last command, as decided on this frame.
    """

    path: Path
    info: RecordingInfo
    outcome: str
    time_s: FloatArray
    state: FloatArray
    action: FloatArray

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    @property
    def state_names(self) -> list[str]:
        """Names of the columns of `state`."""
        assert self.info.gripper is not None
        return state_names(self.info.layout, self.info.gripper.drive)

    @property
    def action_names(self) -> list[str]:
        """Names of the columns of `action`."""
        assert self.info.gripper is not None
        return action_names(self.info.gripper.drive)

    def at_rate(self, fps: int) -> NDArray[np.intp]:
        """Return the frame nearest to each tick of an even grid from the first.

        Raises
        ------
        RecordingError
            If there are too few frames; frames are not interpolated.
        """
        if self.rate_hz < _MIN_RATE_FRACTION * fps:
            raise RecordingError(
                f"{self.path}: {self.rate_hz:.3g} frames/s can't fill {fps} ticks/s; lower --fps"
            )
        from_start_s = self.time_s - self.time_s[0]
        ticks_s = np.arange(math.floor(from_start_s[-1] * fps + 0.5) + 1) / fps
        middles_s = (from_start_s[1:] + from_start_s[:-1]) / 2
        return np.searchsorted(middles_s, ticks_s)


def state_names(layout: ArrayLayout, drive: str) -> list[str]:
    """Return the observation names of a sensor on a gripper of one drive.

    Examples
    --------
    >>> from palpate.sensor.array import RIGID_LAYOUT
    >>> state_names(RIGID_LAYOUT, "width")[:5]
    ['width_mm', 'force_n', 'force_low_n', 'force_high_n', 'r0c0_change_percent']
    """
    cells = ((row, col) for row in range(layout.rows) for col in range(layout.cols))
    pixels = [f"r{row}c{col}_change_percent" for row, col in cells]
    return [_POSITION[drive][0], "force_n", "force_low_n", "force_high_n", *pixels]


def action_names(drive: str) -> list[str]:
    """Return the names of the action of a drive.

    Examples
    --------
    >>> action_names("pressure")
    ['pressure_kpa', 'rate_kpa_per_s']
    """
    return list(_POSITION[drive])


def read_grasp(path: Path) -> GraspTrack:
    """Read a recorded grasp and recompute its commands.

    Raises
    ------
    RecordingError
        If the recording is not of a grasp, ends before the rest measurement, or its hand did not
        follow the recomputed commands.
    """
    with RecordingReader(path) as reader:
        start_s = next((frame.time_s for frame, _ in observations(reader)), 0.0)
    clock = ManualClock(start_s)
    source = Replay(path, clock=clock)
    try:
        recorder = _CommandRecorder(source)
        result = replay_grasp(
            source,
            clock=clock,
            gripper=recorder,
            subscribers=[recorder.add_observation],
            watchers=[recorder.add_state],
        )
        return _build_track(path, source.info, result, recorder)
    except RecordingError as error:
        where = "" if str(error).startswith(str(path)) else f"{path}: "
        raise RecordingError(f"{where}{error}") from error
    finally:
        source.close()


def _build_track(
    path: Path, info: RecordingInfo, result: GraspResult, recorder: _CommandRecorder
) -> GraspTrack:
    if result.outcome is Outcome.STOPPED:
        if recorder.steps and recorder.steps[-1][0].frame.time_s >= recorder.end_s:
            raise RecordingError("the user stopped the grasp; leave it out")
        # The stop interrupts this program, not the recorded grasp.
        raise KeyboardInterrupt
    if result.outcome in _BROKEN:
        why = " ".join(result.faults)
        raise RecordingError(
            f"the recomputed grasp ends with {result.outcome} ({why}); leave it out"
        )
    steps = recorder.steps
    if recorder.rest_ohm is None or len(steps) < 2:
        raise RecordingError("the grasp ended before the sensor's rest was measured; leave it out")
    assert info.gripper is not None
    calibration = Calibration.from_text(info.calibration or "", where="the recording")
    following = force_now(calibration)
    state, reader = [], SampleReader(info.layout, recorder.rest_ohm)
    for seen, _ in steps:
        sample = reader.read(seen.frame)
        force = following.step(
            sample.time_s, sample.excess, saturated=sample.has_saturated, lost=sample.has_lost
        )
        position = info.gripper.drive_reading(seen.gripper)
        change = sample.change_percent.ravel()
        state.append([position, force.middle, force.low, force.high, *change])
    return GraspTrack(
        path=path,
        info=info,
        outcome=str(result.outcome),
        time_s=np.array([seen.frame.time_s for seen, _ in steps]),
        state=np.array(state),
        action=np.array([[command.target, command.rate] for _, command in steps]),
    )


class _CommandRecorder:
    """The recorded gripper, which records the command after each observation.

    Attributes
    ----------
    rest_ohm : ndarray or None, shape (rows, cols)
        Rest values measured by the grasp.
    end_s : float
        Time of the user's release or stop; infinite if it was not recorded.
    steps : list of (Observation, GripperCommand)
        Each observation with the command after it.
    """

    def __init__(self, source: Replay) -> None:
        self._recorded = ReplayGripper(source)
        self.end_s = math.inf if source.end is None else source.end.time_s
        self.limits = self._recorded.limits
        self.rest_ohm: FloatArray | None = None
        self.steps: list[tuple[Observation, GripperCommand]] = []
        self._sent: GripperCommand | None = None

    def add_observation(self, observation: Observation) -> None:
        """Add an observation, on which the following commands are based."""
        here = GripperCommand(target=self.limits.drive_reading(observation.gripper), rate=0.0)
        self.steps.append((observation, self._sent or here))

    def add_state(self, grasp_state: GraspState) -> None:
        """Add a state; the first with rest values defines the rest of the grasp."""
        if self.rest_ohm is None and grasp_state.estimate.rest_ohm is not None:
            self.rest_ohm = grasp_state.estimate.rest_ohm

    def state(self) -> GripperState:
        """Return the recorded state."""
        return self._recorded.state()

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Record a command."""
        self._sent = self._recorded.command(wanted)
        if self.steps:
            self.steps[-1] = (self.steps[-1][0], self._sent)
        return self._sent

    def stop(self) -> None:
        """Do nothing."""

    def release(self) -> None:
        """Do nothing; a grasp opens the hand with a command."""

    def close(self) -> None:
        """Do nothing."""
