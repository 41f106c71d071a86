"""The contents of a recording, and its origin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.gripper.interface import GripperLimits
from palpate.sensor.array import ArrayLayout

#: Source of the frames. Every source except `hardware` is simulated and labelled as such.
Origin = Literal["hardware", "firmware-simulated", "twin"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingInfo:
    """Everything needed to interpret the raw counts later.

    Attributes
    ----------
    layout : ArrayLayout
        Pixels, wiring and divider.
    origin : {"hardware", "firmware-simulated", "twin"}
        Source of the frames.
    rig : str or None
        Name or file of the rig.
    firmware_version : str or None
        Version reported by the board.
    calibration : str or None
        Full text of the calibration file used.
    seed : int or None
        Seed of a simulated run.
    versions : mapping of str to str
        Versions of palpate and of the libraries that affect its results.
    gripper : GripperLimits or None
        Drive and range of the gripper, if any.
    target_force_n : float or None
        Requested grip force. With the calibration and the limits, a replay can repeat the live
        decisions.
    expect_size_mm : float or None
        Expected size of the object.
    tighten : int
        Largest number of times that the hand tightens a slipping grip.
    damage : str or None
        Full text of the damage file, if a learned limit applied; a replay needs it.
    kind : str
        Kind of object for the damage limit; empty if none.
    paper : str or None
        Settings of the paper's method as JSON, if the grasp used that method.
    clock_zero_unix_ns : int
        Unix time, nanoseconds, at which the recording's clock read 0 s. 0 for simulated time, so
        the same seed yields the same file.
    """

    layout: ArrayLayout
    origin: Origin
    rig: str | None = None
    firmware_version: str | None = None
    calibration: str | None = None
    seed: int | None = None
    versions: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    gripper: GripperLimits | None = None
    target_force_n: float | None = None
    expect_size_mm: float | None = None
    tighten: int = 0
    damage: str | None = None
    kind: str = ""
    paper: str | None = None
    clock_zero_unix_ns: int = 0

    def __post_init__(self) -> None:
        if self.origin not in get_args(Origin):
            raise ValueError(f"origin {self.origin!r} is not one of {', '.join(get_args(Origin))}")
        object.__setattr__(self, "versions", MappingProxyType(dict(self.versions)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """A timed event, such as a contact, a stop or a user's note."""

    time_s: float
    name: str
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCells:
    """One reading of the reference load cells."""

    #: Device time mapped to the host's clock.
    time_s: float
    #: Converter readings, one per cell; always stored.
    raw: tuple[int, ...]
    #: The same readings in newtons if the cells are calibrated, else empty.
    force_n: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperTrack:
    """Gripper states as columns of shape (n_states,); NaN for a quantity that is not sensed."""

    time_s: NDArray[np.float64]
    width_mm: NDArray[np.float64]
    pressure_kpa: NDArray[np.float64]
    current_ma: NDArray[np.float64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A complete recording in memory; arrays are read-only.

    Attributes
    ----------
    info : RecordingInfo
        Layout, origin, calibration, versions, seed.
    time_s : ndarray, shape (n_frames,)
        Scan time of each frame.
    sequence : ndarray of int, shape (n_frames,)
        Unwrapped frame numbers; gaps are lost frames.
    counts : ndarray of int, shape (n_frames, rows, cols)
        Raw ADC counts, summed over `oversampling` conversions.
    oversampling : ndarray of int, shape (n_frames,)
        Conversions summed per pixel.
    gripper : GripperTrack
        States in the order they were recorded.
    events : tuple of Event
        In the order they were recorded.
    load_cells : tuple of LoadCells
        In the order they were recorded.
    """

    info: RecordingInfo
    time_s: NDArray[np.float64]
    sequence: NDArray[np.int64]
    counts: NDArray[np.int32]
    oversampling: NDArray[np.int32]
    gripper: GripperTrack
    events: tuple[Event, ...]
    load_cells: tuple[LoadCells, ...]
