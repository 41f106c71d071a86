"""Messages between page and devices' process: orders, requests, frames, notes."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.dashboard.grasp_progress import GraspProgress
from palpate.errors import InputError
from palpate.estimate.force_now import ForceLaws
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import GraspResult
from palpate.gripper.interface import GripperLimits
from palpate.recording.contents import Origin
from palpate.sensor.array import ArrayLayout
from palpate.sensor.health import Health

#: Seconds of simulated time, or of a replay, in a second; as `palpate serve --speed` takes it.
MIN_SPEED, MAX_SPEED = 0.1, 20.0
#: Simulated rigs are drawn by a seed of 32 bits.
_MAX_SEED = 2**32 - 1
#: Every finite time of a recording, seconds.
_MAX_TIME_S = sys.float_info.max


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenRig:
    """Close the rig and open this one; `speed` is simulated seconds per real second."""

    name: str
    object_name: str | None = None
    seed: int = 0
    speed: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspOrder:
    """Close on the object and hold it; every frame is recorded.

    `item_id` names the object, if its grasps are to be stored. `damage` is the text of a damage
    file whose limit the grasp respects, and `kind` the kind of produce, where known.
    """

    target_force_n: float | None
    recording: Path
    item_id: str = ""
    damage: str | None = None
    kind: str = ""


@dataclass(frozen=True, slots=True)
class OpenHand:
    """Open the hand, with or without an object."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateRest:
    """Take the rest values with open gripper and unloaded sensor, and update the file."""

    file: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateForce:
    """Newtons: by the simulated load cell, or by these dead weights, one after the other."""

    file: Path
    loads_n: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Examine:
    """Judge the sensor by its readings at rest."""

    duration_s: float = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """Decide a recorded grasp again, or show the frames of another recording."""

    file: Path
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Record:
    """Record the watched frames to a new file; None ends the recording."""

    file: Path | None


Order: TypeAlias = (
    OpenRig | GraspOrder | OpenHand | CalibrateRest | CalibrateForce | Examine | Play | Record
)


@dataclass(frozen=True, slots=True)
class StopNow:
    """End the running job, with the reaction of the safety rules for its phase.

    `number` counts the stops, so that each can be confirmed.
    """

    number: int = 0


@dataclass(frozen=True, slots=True)
class ReleaseNow:
    """Release the object."""


@dataclass(frozen=True, slots=True)
class Confirm:
    """The user has completed a guided step."""


@dataclass(frozen=True, slots=True)
class SetSpeed:
    """Set the seconds of simulated time, or of the replay, in a second."""

    speed: float


@dataclass(frozen=True, slots=True)
class Seek:
    """Show the replay from this time of the recording on."""

    time_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Pause or continue the replay."""

    paused: bool


@dataclass(frozen=True, slots=True)
class Shutdown:
    """The page ends: stop the running job, and end too."""


Request: TypeAlias = StopNow | ReleaseNow | Confirm | SetSpeed | Seek | Pause | Shutdown


def check_ranges(message: Order | Request) -> None:
    """Refuse numbers of a browser that would end the devices' process.

    Raises
    ------
    InputError
        If a speed, a seed or a time is out of range.
    """
    match message:
        case OpenRig(seed=seed) if not (_is_within(seed, 0, _MAX_SEED) and seed % 1 == 0):
            raise InputError(f"seed: a whole number from 0 to {_MAX_SEED}")
        case OpenRig(speed=speed) | Play(speed=speed) | SetSpeed(speed=speed):
            if not _is_within(speed, MIN_SPEED, MAX_SPEED):
                raise InputError(f"speed: from {MIN_SPEED:g} to {MAX_SPEED:g}")
        case Seek(time_s=time_s) if not _is_within(time_s, -_MAX_TIME_S, _MAX_TIME_S):
            raise InputError("this time is not in the recording")


def _is_within(value: object, low: float, high: float) -> bool:
    return isinstance(value, int | float) and low <= value <= high


class DeviceActivity(StrEnum):
    """Activity of the devices."""

    IDLE = "no rig"
    OPENING = "opening the rig"
    WATCHING = "watching"
    GRASPING = "grasping"
    RELEASING = "opening the hand"
    CALIBRATING_REST = "calibrating rest"
    CALIBRATING_FORCE = "calibrating force"
    EXAMINING = "examining"
    REPLAYING = "replaying"
    GONE = "gone"


class Action(StrEnum):
    """Actions of the page, apart from stop."""

    OPEN = "open a rig"
    GRASP = "grasp"
    RELEASE = "release"
    CALIBRATE = "calibrate"
    EXAMINE = "examine"
    PLAY = "replay"
    RECORD = "record"
    CONFIRM = "confirm"
    SPEED = "change the speed"
    SEEK = "move the replay"
    FILES = "rename or delete"


ACTIVITIES: dict[type[Order], DeviceActivity] = {
    OpenRig: DeviceActivity.OPENING,
    GraspOrder: DeviceActivity.GRASPING,
    OpenHand: DeviceActivity.RELEASING,
    CalibrateRest: DeviceActivity.CALIBRATING_REST,
    CalibrateForce: DeviceActivity.CALIBRATING_FORCE,
    Examine: DeviceActivity.EXAMINING,
    Play: DeviceActivity.REPLAYING,
}
ACTIONS: dict[type[Order | Request], Action] = {
    OpenRig: Action.OPEN,
    GraspOrder: Action.GRASP,
    OpenHand: Action.RELEASE,
    CalibrateRest: Action.CALIBRATE,
    CalibrateForce: Action.CALIBRATE,
    Examine: Action.EXAMINE,
    Play: Action.PLAY,
    Record: Action.RECORD,
    ReleaseNow: Action.RELEASE,
    Confirm: Action.CONFIRM,
    SetSpeed: Action.SPEED,
    Seek: Action.SEEK,
    Pause: Action.SEEK,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSource:
    """The source of the following frames."""

    #: Name of the rig, or of the recording.
    name: str
    #: Layout of the frames.
    layout: ArrayLayout
    #: Rest values to read them by, shape (rows, cols).
    rest_ohm: NDArray[np.float64] | None
    #: Drive and range of the gripper; None for a sensor alone.
    gripper: GripperLimits | None
    #: Anything but hardware is called simulated wherever it is shown.
    origin: Origin
    #: Object between the fingers, where that is known.
    subject: str | None = None
    #: Whether it is a recording.
    replayed: bool = False
    #: Whether a force calibration can be made without weights.
    has_load_cell: bool = False
    #: Text of the calibration and its date; empty without one.
    calibration: str = ""
    calibrated_at: str = ""
    #: Force laws; None where the force was not calibrated.
    laws: ForceLaws | None = None

    @property
    def is_simulated(self) -> bool:
        """Whether any of it is simulated."""
        return self.origin != "hardware"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkStatus:
    """The state of the sensor's link, as seen by the process that owns it."""

    #: Frames received since the source was opened, and missing in the numbering.
    frames: int = 0
    lost: int = 0
    #: Packets that the serial link counted as corrupt, and as late.
    corrupt: int = 0
    late: int = 0
    #: Frames scanned per second of the sensor's time, lost ones included; NaN before two
    #: came.
    rate_hz: float = float("nan")
    #: Time since the last frame; NaN before the first.
    age_s: float = float("nan")
    #: Whether `age_s` is more than five periods, and more than 100 ms.
    stale: bool = True
    #: Time between two frames in this process, over the last thousand: 99th percentile,
    #: longest.
    period_p99_s: float = float("nan")
    period_worst_s: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Frames since the last message, as columns; the gripper's are NaN without a report."""

    time_s: NDArray[np.float64]
    counts: NDArray[np.int32]
    oversampling: int
    reported: NDArray[np.float64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderStarted:
    """An order is being carried out."""

    order: Order


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """An instruction to the user, or the progress of a job."""

    text: str
    #: Fraction of the job that is done; None if unknown.
    fraction: float | None = None
    #: Whether the job waits until the user confirms the step.
    needs_confirmation: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationRenewed:
    """A calibration was renewed."""

    file: Path
    #: Rest values, and how far they are from those before, shape (rows, cols).
    rest_ohm: NDArray[np.float64]
    change_percent: NDArray[np.float64]
    #: Expected errors of the force, percent, by force; empty after a rest calibration.
    held_out: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasped:
    """A grasp has ended; on simulated rigs with the twin's own values."""

    #: The controller's answer.
    result: GraspResult
    #: The twin's own values; None on real rigs.
    truth: Mapping[str, object] | None = None
    #: File with every frame of it.
    recording: Path | None = None
    #: Measurements of the whole closing, by their names in the store.
    closing: Mapping[str, Measurement] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderEnded:
    """An order has ended."""

    order: Order
    #: Its result.
    found: Grasped | CalibrationRenewed | Health | None = None
    #: Empty, or one line with the problem and the remedy.
    trouble: str = ""
    #: Whether it was stopped before it had a result, or before it began.
    stopped: bool = False
    #: If it was stopped: time from the request until the hand received it, on the rig's
    #: clock.
    stopped_after_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSegment:
    """A part of a recording, for its curve, and the grasp's progress at its end."""

    frames: Frames
    progress: GraspProgress | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """A recording as a whole: every stretch of it was sent."""

    start_s: float
    end_s: float
    #: When each phase of its grasp began; empty where it holds none.
    phases: tuple[tuple[float, str], ...]
    #: Progress of the grasp at its end.
    ended: GraspProgress | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayPosition:
    """The position of a replay."""

    time_s: float
    paused: bool
    speed: float
    #: How the grasp ended, once the replay is there.
    grasped: Grasped | None


@dataclass(frozen=True, slots=True)
class StopConfirmed:
    """Stops up to this number have reached the hand, if there is one."""

    number: int


@dataclass(frozen=True, slots=True)
class Trouble:
    """A fault of the devices outside of an order."""

    text: str


@dataclass(frozen=True, slots=True)
class RecordingChanged:
    """The file of the present recording; None after its end."""

    file: Path | None


@dataclass(frozen=True, slots=True)
class DevicesLost:
    """The devices' process is gone."""

    text: str


Note: TypeAlias = (
    FrameSource
    | OrderStarted
    | Guide
    | OrderEnded
    | StopConfirmed
    | Trouble
    | RecordingChanged
    | RecordedSegment
    | Timeline
    | ReplayPosition
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Update:
    """One message: notes in their order, then the newest of everything else."""

    notes: tuple[Note, ...]
    link: LinkStatus
    frames: Frames | None = None
    progress: GraspProgress | None = None
