"""What the page sends to the devices' process: orders, and requests that interrupt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenRig:
    """Close the rig and open this one; `speed`: seconds of simulated time in a real one."""

    name: str
    object_name: str | None = None
    seed: int = 0
    speed: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspOrder:
    """Close on what is there and hold it; every frame goes to the recording.

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
    """Judge the sensor by its readings at rest."""

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


@dataclass(frozen=True, slots=True)
class StopNow:
    """End what runs; the hand does what the safety rules prescribe for its phase.

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
    """Set the seconds of simulated time, or of the replay, in a second."""

    speed: float


@dataclass(frozen=True, slots=True)
class Seek:
    """Show the replay from this time of the recording on."""

    time_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Pause the replay, or go on."""

    paused: bool


@dataclass(frozen=True, slots=True)
class Shutdown:
    """The page ends: stop what runs, and end too."""


Request: TypeAlias = StopNow | ReleaseNow | Confirm | SetSpeed | Seek | Pause | Shutdown
