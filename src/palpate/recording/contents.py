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

#: Where the frames came from. Anything but `hardware` is simulated, and is labelled so.
Origin = Literal["hardware", "firmware-simulated", "twin"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingInfo:
    """Everything needed to make sense of the raw counts later.

    Attributes
    ----------
    layout : ArrayLayout
        Pixels, wiring and divider.
    origin : {"hardware", "firmware-simulated", "twin"}
        What produced the frames.
    rig : str or None
        Name or file of the rig.
    firmware_version : str or None
        As the board identified itself.
    calibration : str or None
        The calibration file's whole text, as it was used.
    seed : int or None
        Seed of a simulated run.
    versions : mapping of str to str
        Versions of palpate and of what its numbers rest on.
    gripper : GripperLimits or None
        Drive and range of the gripper, where there was one.
    target_force_n : float or None
        Grip force that was asked for: with the calibration and the limits, what a replay needs to
        decide again as it was decided live.
    expect_size_mm : float or None
        Size that the object was expected to have.
    damage : str or None
        The damage file's whole text, where a learned limit was kept to: a replay needs it too.
    kind : str
        Kind of object that the damage limit was given; empty if none.
    paper : str or None
        Settings of the paper's method as JSON, where the grasp followed it.
    clock_zero_unix_ns : int
        Unix time, nanoseconds, at which the recording's clock read 0 s. 0 for simulated time, so
        that the same seed gives the same file.
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
    damage: str | None = None
    kind: str = ""
    paper: str | None = None
    clock_zero_unix_ns: int = 0

    def __post_init__(self) -> None:
        if self.origin not in get_args(Origin):
            raise ValueError(f"origin {self.origin!r} is none of {', '.join(get_args(Origin))}")
        object.__setattr__(self, "versions", MappingProxyType(dict(self.versions)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that happened at one moment: a contact, a stop, a user's note."""

    time_s: float
    name: str
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCells:
    """One reading of the reference load cells."""

    #: Device time mapped to the host's clock.
    time_s: float
    #: Converter readings, one per cell; always kept.
    raw: tuple[int, ...]
    #: The same in newton where the cells are calibrated, else empty.
    force_n: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperTrack:
    """Gripper states as columns, each of shape (n_states,); NaN where not sensed."""

    time_s: NDArray[np.float64]
    width_mm: NDArray[np.float64]
    pressure_kpa: NDArray[np.float64]
    current_ma: NDArray[np.float64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A whole recording in memory; arrays are read-only.

    Attributes
    ----------
    info : RecordingInfo
        Layout, origin, calibration, versions, seed.
    time_s : ndarray, shape (n_frames,)
        When each frame was scanned.
    sequence : ndarray of int, shape (n_frames,)
        Frame numbers without wrap: gaps are lost frames.
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
