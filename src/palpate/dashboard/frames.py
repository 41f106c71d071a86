"""Frames on their way to the page, where they come from, and how well the link works."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.dashboard.grip_force import ForceLaws
from palpate.gripper.interface import GripperLimits
from palpate.recording.contents import Origin
from palpate.sensor.array import ArrayLayout


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSource:
    """Where the frames arrive from, from now on."""

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
    #: Text of the calibration; empty without one.
    calibration: str = ""
    #: Force laws; None where the force was not calibrated.
    laws: ForceLaws | None = None

    @property
    def simulated(self) -> bool:
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
    #: Frames that came too fast to be drawn. They are missing nowhere else.
    undrawn: int = 0
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
