"""Orders and requests to the devices' process, and which activity and action each belongs to."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TypeAlias

from palpate.errors import InputError

#: Seconds of simulated time, or of a replay, in a second; as `palpate serve --speed` takes it.
SLOWEST, FASTEST = 0.1, 20.0
#: Simulated rigs are drawn by a seed of 32 bits.
_MOST_SEED = 2**32 - 1
#: Every finite time of a recording, seconds.
_MOST_S = sys.float_info.max


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


def check_numbers(message: Order | Request) -> None:
    """Refuse numbers that would end the devices' process: a browser may send anything.

    Raises
    ------
    InputError
        If a speed, a seed or a time is out of range.
    """
    match message:
        case OpenRig(seed=seed) if not (_is_within(seed, 0, _MOST_SEED) and seed % 1 == 0):
            raise InputError(f"seed: a whole number from 0 to {_MOST_SEED}")
        case OpenRig(speed=speed) | Play(speed=speed) | SetSpeed(speed=speed):
            if not _is_within(speed, SLOWEST, FASTEST):
                raise InputError(f"speed: from {SLOWEST:g} to {FASTEST:g}")
        case Seek(time_s=time_s) if not _is_within(time_s, -_MOST_S, _MOST_S):
            raise InputError("no such moment in the recording")


def _is_within(value: object, low: float, high: float) -> bool:
    return isinstance(value, int | float) and low <= value <= high


class Activity(StrEnum):
    """What the devices are doing."""

    IDLE = "no rig"
    OPENING = "opening the rig"
    WATCHING = "watching"
    GRASPING = "grasping"
    RELEASING = "opening the hand"
    RESTING = "calibrating rest"
    WEIGHING = "calibrating force"
    EXAMINING = "examining"
    REPLAYING = "replaying"
    GONE = "gone"


class Action(StrEnum):
    """What can be pressed, apart from stop."""

    OPEN = "open a rig"
    GRASP = "grasp"
    RELEASE = "release"
    CALIBRATE = "calibrate"
    EXAMINE = "examine"
    PLAY = "replay"
    RECORD = "record"
    CONFIRM = "confirm"
    SPEED = "change the speed"
    STEER = "move the replay"
    FILES = "rename or delete"


ACTIVITIES: dict[type[Order], Activity] = {
    OpenRig: Activity.OPENING,
    GraspOrder: Activity.GRASPING,
    OpenHand: Activity.RELEASING,
    CalibrateRest: Activity.RESTING,
    CalibrateForce: Activity.WEIGHING,
    Examine: Activity.EXAMINING,
    Play: Activity.REPLAYING,
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
    Seek: Action.STEER,
    Pause: Action.STEER,
}
