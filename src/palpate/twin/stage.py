"""The interface of the simulated world for its devices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.clock import ManualClock
from palpate.sensor.array import ArrayLayout


class Scanned(Protocol):
    """Pixels that can be scanned. Times asked for must not go backwards."""

    #: Called with the time before the world moves on to it.
    watchers: list[Callable[[float], None]]
    #: The clock that the devices move.
    clock: ManualClock
    #: Pixels and readout.
    layout: ArrayLayout
    #: Rate at which the array is scanned.
    frame_rate_hz: float
    #: Conversions summed per pixel.
    oversampling: int

    def scan(self, time_s: float) -> NDArray[np.int32]:
        """Return one scan of the array: counts summed over the conversions, shape (rows, cols)."""
        ...


class Stage(Scanned, Protocol):
    """A world with fingers, an object between them, and pixels under its load.

    The twin's own (`palpate.twin.world.World`) is one; a study or a bridge may bring another, made
    of recordings or of another simulator's physics.
    """

    #: What drives the fingers: width or pressure.
    gripper: Literal["rigid", "soft"]
    #: Seed of the devices' noise.
    seed: int
    #: Seed of the sensor and the gripper.
    sheet_seed: int
    #: How much devices scatter (`palpate.twin.ranges`).
    level: str

    def now_s(self) -> float:
        """Return the clock's time, seconds."""
        ...

    def drive(self, target: float, *, rate: float, time_s: float | None = None) -> float:
        """Move the fingers to a width (mm, mm/s) or pressure to a value (kPa, kPa/s)."""
        ...

    def halt(self, *, time_s: float | None = None) -> None:
        """Stop the fingers where they are."""
        ...

    def drive_value(self, time_s: float) -> float:
        """Return the present width (mm) or pressure (kPa)."""
        ...

    def is_moving(self, time_s: float) -> bool:
        """Return whether the fingers are on their way."""
        ...

    def force_n(self, time_s: float) -> float:
        """Return the grip force, newtons."""
        ...

    def pixel_voltage_v(self, time_s: float) -> NDArray[np.float64]:
        """Return the voltage at the converter's input for each pixel, shape (rows, cols)."""
        ...
