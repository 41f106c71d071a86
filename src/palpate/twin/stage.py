"""Interface between the simulated world and its devices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.clock import ManualClock
from palpate.sensor.array import ArrayLayout


class ScannedPixels(Protocol):
    """Pixels that can be scanned at non-decreasing times."""

    #: Called with the new time before the world advances to it.
    watchers: list[Callable[[float], None]]
    #: The clock advanced by the devices.
    clock: ManualClock
    #: Pixels and readout.
    layout: ArrayLayout
    #: Scan rate of the array.
    frame_rate_hz: float
    #: Conversions summed per pixel.
    oversampling: int

    def scan(self, time_s: float) -> NDArray[np.int32]:
        """Return one scan of the array: counts summed over the conversions, shape (rows, cols)."""
        ...


class Stage(ScannedPixels, Protocol):
    """A world with fingers, an object between them, and pixels under load.

    `palpate.twin.world.World` implements this interface. A study or a bridge may provide another
    implementation, based on recordings or another simulator.
    """

    #: Kind of fingers: rigid (driven by width) or soft (driven by pressure).
    gripper: Literal["rigid", "soft"]
    #: Seed of the devices' noise.
    seed: int
    #: Seed of the sensor and the gripper.
    sheet_seed: int
    #: Level of the random variation (`palpate.twin.ranges`).
    level: str

    def now_s(self) -> float:
        """Return the clock's time, seconds."""
        ...

    def drive(self, target: float, *, rate: float, time_s: float | None = None) -> float:
        """Start a movement to a width (mm, mm/s) or pressure (kPa, kPa/s); return the target."""
        ...

    def halt(self, *, time_s: float | None = None) -> None:
        """Stop the fingers in place."""
        ...

    def drive_value(self, time_s: float) -> float:
        """Return the present width (mm) or pressure (kPa)."""
        ...

    def is_moving(self, time_s: float) -> bool:
        """Return whether the fingers are moving."""
        ...

    def force_n(self, time_s: float) -> float:
        """Return the grip force, newtons."""
        ...

    def pixel_voltage_v(self, time_s: float) -> NDArray[np.float64]:
        """Return the voltage at the converter's input for each pixel, shape (rows, cols)."""
        ...
