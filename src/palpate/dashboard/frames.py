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
        Force laws; None where the force was not calibrated.
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
class LinkStatus:
    """The state of the sensor's link, as seen by the process that owns it.

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
        Frames that came too fast to be drawn. They are missing nowhere else.
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
    """Frames since the last message, as columns; the gripper's are NaN without a report."""

    time_s: NDArray[np.float64]
    counts: NDArray[np.int32]
    oversampling: int
    reported: NDArray[np.float64]
    moving: NDArray[np.bool_]
