"""What the devices' process reports to the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.dashboard.frames import Frames, FrameSource, LinkStatus
from palpate.dashboard.grasp_progress import GraspProgress
from palpate.dashboard.orders import Order
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import GraspResult
from palpate.sensor.health import Health


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
class Ended:
    """An order has ended."""

    order: Order
    #: Its result.
    found: Grasped | Calibrated | Health | None = None
    #: Empty, or one line with the problem and the remedy.
    trouble: str = ""
    #: Whether it was stopped before it had a result, or before it began.
    stopped: bool = False
    #: If it was stopped: time from the request until the hand received it, on the rig's
    #: clock.
    stopped_after_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedStretch:
    """A stretch of a recording, for its curve, and the progress of the grasp at its end."""

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
class Playing:
    """Where a replay is."""

    time_s: float
    paused: bool
    speed: float
    #: How the grasp ended, once the replay is there.
    grasped: Grasped | None


@dataclass(frozen=True, slots=True)
class StopConfirmed:
    """Stops up to this number reached the hand, or there is none that could move."""

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
class DevicesLost:
    """The devices' process is gone."""

    text: str


Note: TypeAlias = (
    FrameSource
    | Began
    | Guide
    | Grasped
    | Ended
    | StopConfirmed
    | Trouble
    | BeingRecorded
    | RecordedStretch
    | Timeline
    | Playing
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Update:
    """One message: notes in their order, then the newest of everything else."""

    notes: tuple[Note, ...]
    link: LinkStatus
    frames: Frames | None = None
    progress: GraspProgress | None = None
