"""What passes between the page's process and the devices' process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.dashboard.grip_force import ContactGains, ForceLaws
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import GraspResult, Moment
from palpate.gripper.interface import GripperLimits
from palpate.recording.contents import Origin
from palpate.sensor.array import ArrayLayout
from palpate.sensor.health import Health

# -- what the page orders -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenRig:
    """Let go of the rig and open this one; `speed`: seconds of simulated time in a real one."""

    name: str
    object_name: str | None = None
    seed: int = 0
    speed: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspOrder:
    """Close on what is there and hold it; every frame goes to the recording.

    `item_id` names what it is, where it is to be remembered. `damage` is the text of a damage file
    whose limit is kept to, and `kind` what is grasped, where known.
    """

    target_force_n: float | None
    recording: Path
    item_id: str = ""
    damage: str | None = None
    kind: str = ""


@dataclass(frozen=True, slots=True)
class OpenHand:
    """Open the hand, whatever it holds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateRest:
    """Take the rest values with the hand open and nothing on the sensor; renew the file."""

    file: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateForce:
    """Newtons: by the simulated load cell, or by these dead weights, one after the other."""

    file: Path
    loads_n: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Examine:
    """Judge the sensor by so many seconds at rest."""

    duration_s: float = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """Decide a recorded grasp again, or show the frames of another recording."""

    file: Path
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Record:
    """Record what is watched to a new file; None ends the recording."""

    file: Path | None


Order: TypeAlias = (
    OpenRig | GraspOrder | OpenHand | CalibrateRest | CalibrateForce | Examine | Play | Record
)

# -- what is heard at once, whatever runs --------------------------------------------------------


@dataclass(frozen=True, slots=True)
class StopNow:
    """End what runs; the hand does what the safety rules say for its phase.

    `number` counts the stops, so that each can be confirmed.
    """

    number: int = 0


@dataclass(frozen=True, slots=True)
class ReleaseNow:
    """Give the object back."""


@dataclass(frozen=True, slots=True)
class Confirm:
    """The user did what a guided step asked for."""


@dataclass(frozen=True, slots=True)
class SetSpeed:
    """Let simulated time run so many times as fast as the clock on the wall."""

    speed: float


@dataclass(frozen=True, slots=True)
class Seek:
    """Show the replay from this time of the recording on."""

    time_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Let the replay stand still, or go on."""

    paused: bool


@dataclass(frozen=True, slots=True)
class Goodbye:
    """The page ends: stop what runs, and end too."""


Urgent: TypeAlias = StopNow | ReleaseNow | Confirm | SetSpeed | Seek | Pause | Goodbye

# -- what the devices' process tells -------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSource:
    """Where the frames come from, from now on.

    Attributes
    ----------
    name : str
        Name of the rig, or of the recording.
    layout : ArrayLayout
        Of the frames.
    rest_ohm : ndarray or None, shape (rows, cols)
        Rest values to read them by.
    gripper : GripperLimits or None
        Drive and range, where there is a gripper.
    origin : {"hardware", "firmware-simulated", "twin"}
        What is not hardware is called simulated wherever it is shown.
    subject : str or None
        What lies between the fingers, where that is known.
    replayed : bool
        Whether it is a recording.
    has_load_cell : bool
        Whether a force calibration can be made without weights.
    laws : ForceLaws or None
        What newtons are read by; None where the force was not calibrated.
    """

    name: str
    layout: ArrayLayout
    rest_ohm: NDArray[np.float64] | None
    gripper: GripperLimits | None
    origin: Origin
    subject: str | None = None
    replayed: bool = False
    has_load_cell: bool = False
    laws: ForceLaws | None = None

    @property
    def simulated(self) -> bool:
        """Whether any of it is simulated."""
        return self.origin != "hardware"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pulse:
    """The link, as the process sees it that holds it.

    Attributes
    ----------
    frames, lost : int
        Received since the source was opened, and missing in the numbering.
    corrupt, late : int
        As the serial link counts them.
    rate_hz : float
        Frames scanned per second of the sensor's time, lost ones included; NaN before two came.
    age_s : float
        Since the last frame came; NaN before the first.
    stale : bool
        Whether that is more than five periods, and more than 100 ms.
    undrawn : int
        Frames that came too fast to be drawn. None of them is missing anywhere else.
    period_p99_s, period_worst_s : float
        Time between two frames in this process, over the last thousand: 99th percentile, longest.
    """

    frames: int = 0
    lost: int = 0
    corrupt: int = 0
    late: int = 0
    rate_hz: float = float("nan")
    age_s: float = float("nan")
    stale: bool = True
    undrawn: int = 0
    period_p99_s: float = float("nan")
    period_worst_s: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Frames since the last message, as columns; the gripper's are NaN where it told nothing."""

    time_s: NDArray[np.float64]
    counts: NDArray[np.int32]
    oversampling: int
    reported: NDArray[np.float64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Forces that a grasp is after, and that it keeps below, newtons; None where there is none."""

    target_n: float | None = None
    damage_low_n: float | None = None
    ceiling_n: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Thought:
    """What the controller makes of it.

    Attributes
    ----------
    time_s : float
        Of its last frame.
    phase : str
        What it is doing.
    rest_ohm : ndarray or None, shape (rows, cols)
        Rest values taken for this grasp.
    began_s : float
        When the grasp began.
    force_n : float
        Grip force as the last step read it.
    settled : Measurement or None
        Forecast of the mean relative change at the horizon, from the frames so far.
    answer : GraspResult
        The controller's own once it has decided; before that, what it would say now.
    decided : bool
        Which of the two it is.
    settled_n : Measurement or None
        Forecast of the grip force at the horizon, newtons; goes on after the decision.
    gains : ContactGains
        How this contact reads against the laws.
    touched_s : float or None
        When the fingers first touched the object; None until the controller is sure that they did.
    moments : tuple of Moment
        What the controller noted so far.
    bounds : Bounds
        What the force is to reach, and what it must not.
    """

    time_s: float
    phase: str
    rest_ohm: NDArray[np.float64] | None
    began_s: float
    force_n: float
    settled: Measurement | None
    answer: GraspResult
    decided: bool
    settled_n: Measurement | None = None
    gains: ContactGains = field(default_factory=ContactGains)
    touched_s: float | None = None
    moments: tuple[Moment, ...] = ()
    bounds: Bounds = field(default_factory=Bounds)


@dataclass(frozen=True, slots=True, kw_only=True)
class Began:
    """An order is being carried out."""

    order: Order


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """What the user is to do, or what goes on; `share` of the way, `asks` for a confirmation."""

    text: str
    share: float | None = None
    asks: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrated:
    """A calibration was renewed.

    Attributes
    ----------
    file : Path
        Where it is.
    rest_ohm, change_percent : ndarray, shape (rows, cols)
        Rest values, and how far they are from those before.
    held_out : mapping
        Expected errors of the force, percent, by force; empty after a rest calibration.
    """

    file: Path
    rest_ohm: NDArray[np.float64]
    change_percent: NDArray[np.float64]
    held_out: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasped:
    """A grasp has ended; on simulated rigs with the twin's own values.

    Attributes
    ----------
    result : GraspResult
        What the grasp answers.
    truth : mapping or None
        The twin's own values; None on real rigs.
    recording : Path or None
        Every frame of it.
    closing : mapping of str to Measurement
        What the whole closing tells besides, as the store names it.
    """

    result: GraspResult
    truth: Mapping[str, object] | None = None
    recording: Path | None = None
    closing: Mapping[str, Measurement] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """An order has ended.

    Attributes
    ----------
    order : Order
        Which.
    found : Grasped, Calibrated, Health or None
        What came of it.
    trouble : str
        Empty, or one line that says what went wrong and what to do.
    stopped_after_s : float or None
        Where it was stopped: how long after the request the hand was told, on the rig's clock.
    """

    order: Order
    found: Grasped | Calibrated | Health | None = None
    trouble: str = ""
    stopped_after_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Past:
    """A stretch of a recording, for its curve, and what was thought at its end."""

    frames: Frames
    thought: Thought | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """A recording as a whole: every stretch of it was sent."""

    start_s: float
    end_s: float
    #: When each phase of its grasp began; empty where it holds none.
    phases: tuple[tuple[float, str], ...]
    #: What was thought at its end.
    ended: Thought | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Playing:
    """Where a replay is."""

    time_s: float
    paused: bool
    speed: float
    #: How the grasp ended, once the replay is there.
    grasped: Grasped | None


@dataclass(frozen=True, slots=True)
class Stopped:
    """The hand was told to stop, or there is none that could move: stops up to this number."""

    number: int


@dataclass(frozen=True, slots=True)
class Trouble:
    """A sentence about the devices while nothing was ordered."""

    text: str


@dataclass(frozen=True, slots=True)
class BeingRecorded:
    """What is watched is being recorded to this file; None: no more."""

    file: Path | None


@dataclass(frozen=True, slots=True)
class Lost:
    """The devices' process is gone."""

    text: str


Note: TypeAlias = (
    FrameSource
    | Began
    | Guide
    | Grasped
    | Ended
    | Stopped
    | Trouble
    | BeingRecorded
    | Past
    | Timeline
    | Playing
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Update:
    """One message: notes in their order, then the newest of everything else."""

    notes: tuple[Note, ...]
    pulse: Pulse
    frames: Frames | None = None
    thought: Thought | None = None
