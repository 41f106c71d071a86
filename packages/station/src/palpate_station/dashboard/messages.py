"""Messages between page and device process: orders, requests, frames and notes."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.force.force_law import ForceLaw
from palpate.force.sheet_law import SheetLaw
from palpate.grasp.damage_limit import DamageLimit
from palpate.grasp.document import GraspDocument
from palpate.grasp.estimator import Observation
from palpate.gripper.interface import GripperLimits
from palpate.measurement import Measurement
from palpate.recording.contents import Origin
from palpate.sensor.array import ArrayLayout
from palpate.sensor.health import Health
from palpate_station.dashboard.grasp_progress import GraspProgress

#: Limits of the speed: seconds of simulated time, or of a recording, per real second.
MIN_SPEED, MAX_SPEED = 0.1, 20.0
#: Seeds of simulated rigs have 32 bits.
_MAX_SEED = 2**32 - 1
#: Accepts every finite time of a recording, seconds.
_MAX_TIME_S = sys.float_info.max


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenRig:
    """Close the open rig and open another.

    `speed` is simulated seconds per real second. `rate_hz` is the frame rate of a simulated rig;
    None for its own.
    """

    name: str
    object_name: str | None = None
    seed: int = 0
    speed: float = 1.0
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspOrder:
    """Grasp and hold the object, and record every frame.

    `item_id` identifies an object whose grasps are stored; empty otherwise. `batch` is its batch,
    or empty for that of the page. `limit` is the damage limit that the grasp obeys, if any.
    """

    target_force_n: float | None
    recording: Path
    item_id: str = ""
    batch: str = ""
    limit: DamageLimit | None = None


@dataclass(frozen=True, slots=True)
class OpenHand:
    """Open the hand, with or without an object."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateRest:
    """Measure rest values with open gripper and unloaded sensor, and update the file."""

    file: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateForce:
    """Calibrate the force with the simulated load cell, or with these dead weights in order."""

    file: Path
    loads_n: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Examine:
    """Examine the health of the unloaded sensor."""

    duration_s: float = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """Replay a recording; the controller's decisions are recomputed for a recorded grasp."""

    file: Path
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Record:
    """Order to record the frames received while no order runs; `file` None ends the recording."""

    file: Path | None


Order: TypeAlias = (
    OpenRig | GraspOrder | OpenHand | CalibrateRest | CalibrateForce | Examine | Play | Record
)


@dataclass(frozen=True, slots=True)
class StopNow:
    """Stop the running job; the safety rules define the reaction in each phase.

    `number` is the running number of the stop, which its confirmation repeats.
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
    """Set the speed of the simulation or replay, seconds per real second."""

    speed: float


@dataclass(frozen=True, slots=True)
class Seek:
    """Continue the replay from this time in the recording."""

    time_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Pause or continue the replay."""

    paused: bool


@dataclass(frozen=True, slots=True)
class Shutdown:
    """Stop the running job and end the device process."""


Request: TypeAlias = StopNow | ReleaseNow | Confirm | SetSpeed | Seek | Pause | Shutdown


def check_ranges(message: Order | Request) -> None:
    """Check the numbers of a message from a browser before they reach the device process.

    Raises
    ------
    InputError
        If a speed, a seed or a time is out of range.
    """
    match message:
        case OpenRig(seed=seed) if not (_is_within(seed, 0, _MAX_SEED) and seed % 1 == 0):
            raise InputError(f"the seed must be an integer from 0 to {_MAX_SEED}")
        case OpenRig(speed=speed) | Play(speed=speed) | SetSpeed(speed=speed):
            if not _is_within(speed, MIN_SPEED, MAX_SPEED):
                raise InputError(f"the speed must be from {MIN_SPEED:g} to {MAX_SPEED:g}")
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
    #: Rest values of the pixels, shape (rows, cols); None without a calibration.
    rest_ohm: NDArray[np.float64] | None
    #: Drive and range of the gripper; None without a gripper.
    gripper: GripperLimits | None
    #: Origin of the data; every origin except hardware is labelled as simulated.
    origin: Origin
    #: Object between the fingers, if known.
    subject: str | None = None
    #: Whether the source is a recording.
    replayed: bool = False
    #: Whether the force can be calibrated without weights.
    has_load_cell: bool = False
    #: Text of the calibration and its date; empty without a calibration.
    calibration: str = ""
    calibrated_at: str = ""
    #: Force law; None without a force calibration.
    law: SheetLaw | ForceLaw | None = None

    @property
    def is_simulated(self) -> bool:
        """Whether any of the data is simulated."""
        return self.origin != "hardware"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkStatus:
    """State of the sensor's link in the device process."""

    #: Frames received since the source was opened, and frames missing in the sequence numbers.
    frames: int = 0
    lost: int = 0
    #: Corrupt and late packets of the serial link.
    corrupt: int = 0
    late: int = 0
    #: Frames per second of the sensor's clock, including lost frames; NaN before two frames.
    rate_hz: float = float("nan")
    #: Time since the last frame; NaN before the first.
    age_s: float = float("nan")
    #: Whether `age_s` exceeds both five periods and 100 ms.
    stale: bool = True
    #: Time between arrivals of the last 1000 frames: 99th percentile and maximum.
    period_p99_s: float = float("nan")
    period_worst_s: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """New frames as columns; the gripper's `reported` value is NaN without a report."""

    time_s: NDArray[np.float64]
    counts: NDArray[np.int32]
    oversampling: int
    reported: NDArray[np.float64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderStarted:
    """The device process has started an order."""

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
    """A calibration was updated."""

    file: Path
    #: Rest values and their change from the previous calibration, shape (rows, cols).
    rest_ohm: NDArray[np.float64]
    change_percent: NDArray[np.float64]
    #: Expected errors of the force on held-out loads, percent, by force; empty after a rest
    #: calibration.
    held_out: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasped:
    """A grasp with its answer, while the hand holds the object or at the end."""

    document: GraspDocument
    #: Every frame up to the answer, unless an earlier `Measured` of the grasp had them.
    observations: tuple[Observation, ...] = ()
    #: Recording with every frame of the grasp.
    recording: Path | None = None
    #: Whether the hand opened without a request, at the end of the hold time.
    is_released_alone: bool = False
    #: Measurements of the closing motion, by their names in the store.
    closing: Mapping[str, Measurement] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Measured:
    """The hand holds the object, and the answer is known."""

    grasped: Grasped


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderEnded:
    """An order has ended."""

    order: Order
    #: Result of the order.
    found: Grasped | CalibrationRenewed | Health | None = None
    #: One line with the problem and the remedy; empty after a success.
    trouble: str = ""
    #: Whether the order was stopped before its start or before it had a result.
    stopped: bool = False
    #: Time from the stop request until the hand received it, on the rig's clock; None without a
    #: stop.
    stopped_after_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSegment:
    """Frames of a recording segment, and the grasp progress at its end."""

    frames: Frames
    progress: GraspProgress | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """Time range and phases of a recording, sent after its segments."""

    start_s: float
    end_s: float
    #: Start of each phase of the grasp; empty without a grasp.
    phases: tuple[tuple[float, str], ...]
    #: Progress at the end of the recording; None without a grasp.
    ended: GraspProgress | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayPosition:
    """The current position of a replay."""

    time_s: float
    paused: bool
    speed: float
    #: Result of the grasp; None before the end of the recording.
    grasped: Grasped | None


@dataclass(frozen=True, slots=True)
class StopConfirmed:
    """The hand, if any, has received all stops up to this number."""

    number: int


@dataclass(frozen=True, slots=True)
class Trouble:
    """A fault of the devices outside of an order; empty after its end."""

    text: str


@dataclass(frozen=True, slots=True)
class RecordingChanged:
    """A recording has started, or has ended if `file` is None."""

    file: Path | None


@dataclass(frozen=True, slots=True)
class DevicesLost:
    """The device process has ended."""

    text: str


Note: TypeAlias = (
    FrameSource
    | OrderStarted
    | Guide
    | Measured
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
    """One message to the page: notes in order, new frames and the newest state."""

    notes: tuple[Note, ...]
    link: LinkStatus
    frames: Frames | None = None
    progress: GraspProgress | None = None
