"""The twin's array and gripper with a fault from a given time: one row each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.sensor.array import ArrayLayout, Frame
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import World

Counts: TypeAlias = NDArray[np.int32]
#: Gets the counts of a frame, and those of the first frame of the grasp.
Spoil: TypeAlias = Callable[[Counts, Counts], Counts]
#: Gets a state, and the first one after the fault.
Misreport: TypeAlias = Callable[[GripperState, GripperState], GripperState]
_TOP = 1023


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One single fault; what it leaves out works.

    Attributes
    ----------
    part : str
        What fails: sheet, wire, servo or host.
    spoil : callable or None
        What the frames show instead.
    misreport : callable or None
        What the gripper reports instead.
    silent, gone, numb : bool
        No frames any more; the sensor's port is gone; the gripper does not answer.
    late_s : float
        By how much frames are old when they come.
    runs_on : bool
        The gripper ignores where it was sent, and closes.
    idle : bool
        The gripper does not move.
    back_s : float
        By how much the times of every second frame go back.
    pressed_mm : float
        By how much a force from outside closes the fingers, which report nothing of it.
    hasty : float
        The gripper moves this many times as fast as it was sent.
    nudged_s : float
        The host hangs once for this long.
    stopped : bool
        The user stops the grasp.
    """

    part: str
    spoil: Spoil | None = None
    misreport: Misreport | None = None
    silent: bool = False
    gone: bool = False
    numb: bool = False
    late_s: float = 0.0
    runs_on: bool = False
    idle: bool = False
    back_s: float = 0.0
    pressed_mm: float = 0.0
    hasty: float = 1.0
    nudged_s: float = 0.0
    stopped: bool = False


def _at(where: Any, value: int) -> Spoil:
    def spoil(counts: Counts, first: Counts) -> Counts:
        counts[where] = value
        return counts

    return spoil


def _flat(value: int) -> Spoil:
    """All pixels at one value, with the flicker of a converter."""

    def spoil(counts: Counts, first: Counts) -> Counts:
        return value + counts % 2

    return spoil


def _unfelt(counts: Counts, first: Counts) -> Counts:
    """The object lies off the sheet: each pixel keeps its first reading, with small noise."""
    return np.asarray(np.clip(first + counts % 3 - 1, 2, _TOP - 3), dtype=np.int32)


def _finger_at_rest(counts: Counts, first: Counts) -> Counts:
    """One finger's pixels read as at first, and shake a little; the other's work."""
    counts[: len(counts) // 2] = _unfelt(counts, first)[: len(counts) // 2]
    return counts


def _frozen() -> Spoil:
    kept = list[Counts]()

    def spoil(counts: Counts, first: Counts) -> Counts:
        kept.append(counts)
        return kept[0]

    return spoil


def _reporting(**values: float) -> Misreport:
    return lambda state, first: replace(state, **values)  # type: ignore[arg-type]


def _negative(state: GripperState, first: GripperState) -> GripperState:
    return replace(state, current_ma=-state.current_ma)


def _flickering() -> Misreport:
    turns = count()
    return lambda state, first: replace(state, moving=state.moving != (next(turns) % 2 == 0))


def _frozen_state(state: GripperState, first: GripperState) -> GripperState:
    return replace(first, time_s=state.time_s, moving=False)


#: Name -> a fault, made again for each grasp.
FAULTS: dict[str, Callable[[], Fault]] = {
    "none": lambda: Fault(part="none"),
    "all pixels short": lambda: Fault(part="sheet", spoil=_at(np.s_[:], _TOP)),
    "finger short": lambda: Fault(part="sheet", spoil=_at(np.s_[:2], _TOP)),
    "row short": lambda: Fault(part="sheet", spoil=_at(np.s_[1], _TOP)),
    "column short": lambda: Fault(part="sheet", spoil=_at(np.s_[:, 1], _TOP)),
    "pixel short": lambda: Fault(part="sheet", spoil=_at(np.s_[1, 1], _TOP)),
    "all pixels open": lambda: Fault(part="sheet", spoil=_at(np.s_[:], 0)),
    "row open": lambda: Fault(part="sheet", spoil=_at(np.s_[1], 0)),
    "pixel open": lambda: Fault(part="sheet", spoil=_at(np.s_[1, 1], 0)),
    "object beside the sheet": lambda: Fault(part="sheet", spoil=_unfelt),
    "finger at rest": lambda: Fault(part="sheet", spoil=_finger_at_rest),
    "all pixels 512": lambda: Fault(part="sheet", spoil=_flat(512)),
    "all pixels 1020": lambda: Fault(part="sheet", spoil=_flat(1020)),
    "inverted": lambda: Fault(part="sheet", spoil=lambda counts, first: _TOP - counts),
    "half the reading": lambda: Fault(part="sheet", spoil=lambda counts, first: counts // 2),
    "frames constant": lambda: Fault(part="wire", spoil=_frozen()),
    "counts of 1024": lambda: Fault(part="wire", spoil=_at(np.s_[0, 0], 1024)),
    "counts of -1": lambda: Fault(part="wire", spoil=_at(np.s_[0, 0], -1)),
    "frame times go back": lambda: Fault(part="wire", back_s=0.3),
    "frames stop": lambda: Fault(part="wire", silent=True),
    "frames 1 s late": lambda: Fault(part="wire", late_s=1.0),
    "port gone": lambda: Fault(part="wire", gone=True),
    "gripper silent": lambda: Fault(part="servo", numb=True),
    "gripper runs on": lambda: Fault(part="servo", runs_on=True),
    "gripper 10 times too fast": lambda: Fault(part="servo", hasty=10.0),
    "gripper does not move": lambda: Fault(part="servo", idle=True),
    "reported width frozen": lambda: Fault(part="servo", misreport=_frozen_state),
    "reported width NaN": lambda: Fault(
        part="servo", misreport=_reporting(width_mm=math.nan, pressure_kpa=math.nan)
    ),
    "current endless": lambda: Fault(part="servo", misreport=_reporting(current_ma=math.inf)),
    "current stuck at 0": lambda: Fault(part="servo", misreport=_reporting(current_ma=0.0)),
    "current absent": lambda: Fault(part="servo", misreport=_reporting(current_ma=math.nan)),
    "current negative": lambda: Fault(part="servo", misreport=_negative),
    "moving flag flickers": lambda: Fault(part="servo", misreport=_flickering()),
    "pressed from outside": lambda: Fault(part="world", pressed_mm=4.0, misreport=_frozen_state),
    "finger at rest, current absent": lambda: Fault(
        part="two at once", spoil=_finger_at_rest, misreport=_reporting(current_ma=math.nan)
    ),
    "finger at rest, 10 times too fast": lambda: Fault(
        part="two at once", spoil=_finger_at_rest, hasty=10.0
    ),
    "host hangs for 1 s": lambda: Fault(part="host", nudged_s=1.0),
    "stopped by the user": lambda: Fault(part="host", stopped=True),
    "gripper 10 times too slow": lambda: Fault(part="servo", hasty=0.1),
    "object beside the sheet, current absent": lambda: Fault(
        part="two at once", spoil=_unfelt, misreport=_reporting(current_ma=math.nan)
    ),
    "pressed from outside, finger at rest": lambda: Fault(
        part="two at once", pressed_mm=4.0, misreport=_frozen_state, spoil=_finger_at_rest
    ),
    "too fast, moving flag flickers": lambda: Fault(
        part="two at once", hasty=10.0, misreport=_flickering()
    ),
}


class FaultyArray:
    """The twin's array until `fault` is set."""

    def __init__(self, world: World) -> None:
        self._array, self._clock = TwinArray(world), world.clock
        self._first: Counts | None = None
        self.fault: Fault | None = None

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._array.layout

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame, as the fault leaves it."""
        fault = self.fault
        if fault is not None and fault.gone:
            raise DeviceError("port /dev/ttyUSB0 vanished; plug it in again")
        if fault is not None and fault.silent:
            self._clock.sleep_s(timeout_s)
            raise DeviceTimeoutError(f"no frame in {timeout_s:.2f} s; check the cable")
        frame = self._array.read(timeout_s=timeout_s)
        if self._first is None:
            self._first = frame.counts
        if fault is None:
            return frame
        if fault.late_s:
            self._clock.sleep_s(fault.late_s)
        if fault.back_s and frame.sequence % 2:
            frame = replace(frame, time_s=frame.time_s - fault.back_s)
        if fault.spoil is None:
            return frame
        return replace(frame, counts=fault.spoil(frame.counts.copy(), self._first))

    def close(self) -> None:
        """Stop scanning."""
        self._array.close()


class FaultyGripper:
    """The twin's gripper until `fault` is set."""

    def __init__(self, world: World) -> None:
        self._gripper, self._world = TwinGripper(world), world
        self._first: GripperState | None = None
        self.fault: Fault | None = None

    @property
    def limits(self) -> GripperLimits:
        """Range and drive."""
        return self._gripper.limits

    def state(self) -> GripperState:
        """Return its state, as the fault leaves it."""
        fault = self._answering()
        state = self._gripper.state()
        if fault is None or fault.misreport is None:
            return state
        self._first = self._first or state
        other = fault.misreport(state, self._first)
        if self.limits.drive == "width":
            return replace(other, pressure_kpa=math.nan)
        return replace(other, width_mm=math.nan, current_ma=math.nan)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send a command, or what the fault makes of it; return what was wanted."""
        fault, limits = self._answering(), self.limits
        closing = limits.target(limits.span)
        if fault is not None and fault.idle:
            return wanted
        if fault is not None and fault.runs_on and wanted.target != limits.target(0.0):
            self._gripper.command(replace(wanted, target=closing))
            return wanted
        if fault is not None and fault.hasty != 1.0:
            sent = self._gripper.command(wanted)
            self._world.drive(sent.target, rate=fault.hasty * sent.rate)
            return sent
        return self._gripper.command(wanted)

    def stop(self) -> None:
        """Stop where it is; soft fingers vent, as their driver does."""
        self._answering()
        if self.limits.drive == "pressure":
            self._gripper.release()
        else:
            self._gripper.stop()

    def release(self) -> None:
        """Open."""
        self._gripper.release()

    def close(self) -> None:
        """Let go of nothing."""

    def _answering(self) -> Fault | None:
        if self.fault is not None and self.fault.numb:
            raise DeviceTimeoutError("the gripper does not reply; check its power")
        return self.fault
