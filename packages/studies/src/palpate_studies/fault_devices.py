"""The twin's array and gripper with an injected fault."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.requests import Requests
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.sensor.array import ArrayLayout, Frame
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import World

Counts: TypeAlias = NDArray[np.int32]
#: From the counts of a frame and of the first frame of the grasp to the faulty counts.
CorruptCounts: TypeAlias = Callable[[Counts, Counts], Counts]
#: From a state and the first state after the fault to the reported state.
AlterState: TypeAlias = Callable[[GripperState, GripperState], GripperState]
_TOP = 1023


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A single fault.

    Attributes
    ----------
    part : str
        Failing part: sheet, wire, servo or host.
    corrupt : callable or None
        Replaces the counts of each frame.
    alter_state : callable or None
        Replaces the state that the gripper reports.
    no_frames, port_lost, no_reply : bool
        The sensor sends no frames; its port vanished; the gripper does not reply.
    delay_s : float
        Delay of each frame.
    closes_fully : bool
        The gripper ignores its target and closes.
    does_not_move : bool
        The gripper does not move.
    time_jump_s : float
        Backward jump of the timestamps of every second frame.
    pushed_mm : float
        Closure of the fingers by an external force, which they do not report.
    speed_factor : float
        Actual over commanded speed of the gripper.
    hang_s : float
        The host hangs once for this long.
    user_stops : bool
        The user stops the grasp.
    """

    part: str
    corrupt: CorruptCounts | None = None
    alter_state: AlterState | None = None
    no_frames: bool = False
    port_lost: bool = False
    no_reply: bool = False
    delay_s: float = 0.0
    closes_fully: bool = False
    does_not_move: bool = False
    time_jump_s: float = 0.0
    pushed_mm: float = 0.0
    speed_factor: float = 1.0
    hang_s: float = 0.0
    user_stops: bool = False


def _set_pixels(where: Any, value: int) -> CorruptCounts:
    def corrupt(counts: Counts, first: Counts) -> Counts:
        counts[where] = value
        return counts

    return corrupt


def _set_all_flickering(value: int) -> CorruptCounts:
    """Set all pixels to one value with the flicker of a converter."""

    def corrupt(counts: Counts, first: Counts) -> Counts:
        return value + counts % 2

    return corrupt


def _hold_first_counts(counts: Counts, first: Counts) -> Counts:
    """Repeat the first reading of each pixel with small noise, as off the sheet."""
    return np.asarray(np.clip(first + counts % 3 - 1, 2, _TOP - 3), dtype=np.int32)


def _hold_one_finger(counts: Counts, first: Counts) -> Counts:
    """Repeat the first readings of one finger with small noise."""
    counts[: len(counts) // 2] = _hold_first_counts(counts, first)[: len(counts) // 2]
    return counts


def _repeat_counts() -> CorruptCounts:
    seen = list[Counts]()

    def corrupt(counts: Counts, first: Counts) -> Counts:
        seen.append(counts)
        return seen[0]

    return corrupt


def _replace_values(**values: float) -> AlterState:
    return lambda state, first: replace(state, **values)  # type: ignore[arg-type]


def _negate_current(state: GripperState, first: GripperState) -> GripperState:
    return replace(state, current_ma=-state.current_ma)


def _flicker_moving() -> AlterState:
    turns = count()
    return lambda state, first: replace(state, moving=state.moving != (next(turns) % 2 == 0))


def _repeat_first_state(state: GripperState, first: GripperState) -> GripperState:
    return replace(first, time_s=state.time_s, moving=False)


#: Name -> factory of a fault, called for each grasp.
FAULTS: dict[str, Callable[[], Fault]] = {
    "none": lambda: Fault(part="none"),
    "all pixels short": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[:], _TOP)),
    "finger short": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[:2], _TOP)),
    "row short": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[1], _TOP)),
    "column short": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[:, 1], _TOP)),
    "pixel short": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[1, 1], _TOP)),
    "all pixels open": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[:], 0)),
    "row open": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[1], 0)),
    "pixel open": lambda: Fault(part="sheet", corrupt=_set_pixels(np.s_[1, 1], 0)),
    "object beside the sheet": lambda: Fault(part="sheet", corrupt=_hold_first_counts),
    "finger at rest": lambda: Fault(part="sheet", corrupt=_hold_one_finger),
    "all pixels 512": lambda: Fault(part="sheet", corrupt=_set_all_flickering(512)),
    "all pixels 1020": lambda: Fault(part="sheet", corrupt=_set_all_flickering(1020)),
    "inverted": lambda: Fault(part="sheet", corrupt=lambda counts, first: _TOP - counts),
    "half the reading": lambda: Fault(part="sheet", corrupt=lambda counts, first: counts // 2),
    "frames constant": lambda: Fault(part="wire", corrupt=_repeat_counts()),
    "counts of 1024": lambda: Fault(part="wire", corrupt=_set_pixels(np.s_[0, 0], 1024)),
    "counts of -1": lambda: Fault(part="wire", corrupt=_set_pixels(np.s_[0, 0], -1)),
    "frame times go back": lambda: Fault(part="wire", time_jump_s=0.3),
    "frames stop": lambda: Fault(part="wire", no_frames=True),
    "frames 1 s late": lambda: Fault(part="wire", delay_s=1.0),
    "port gone": lambda: Fault(part="wire", port_lost=True),
    "gripper silent": lambda: Fault(part="servo", no_reply=True),
    "gripper runs on": lambda: Fault(part="servo", closes_fully=True),
    "gripper 10 times too fast": lambda: Fault(part="servo", speed_factor=10.0),
    "gripper does not move": lambda: Fault(part="servo", does_not_move=True),
    "reported width frozen": lambda: Fault(part="servo", alter_state=_repeat_first_state),
    "reported width NaN": lambda: Fault(
        part="servo", alter_state=_replace_values(width_mm=math.nan, pressure_kpa=math.nan)
    ),
    "current endless": lambda: Fault(
        part="servo", alter_state=_replace_values(current_ma=math.inf)
    ),
    "current stuck at 0": lambda: Fault(part="servo", alter_state=_replace_values(current_ma=0.0)),
    "current absent": lambda: Fault(part="servo", alter_state=_replace_values(current_ma=math.nan)),
    "current negative": lambda: Fault(part="servo", alter_state=_negate_current),
    "moving flag flickers": lambda: Fault(part="servo", alter_state=_flicker_moving()),
    "pressed from outside": lambda: Fault(
        part="world", pushed_mm=4.0, alter_state=_repeat_first_state
    ),
    "finger at rest, current absent": lambda: Fault(
        part="two at once",
        corrupt=_hold_one_finger,
        alter_state=_replace_values(current_ma=math.nan),
    ),
    "finger at rest, 10 times too fast": lambda: Fault(
        part="two at once", corrupt=_hold_one_finger, speed_factor=10.0
    ),
    "host hangs for 1 s": lambda: Fault(part="host", hang_s=1.0),
    "stopped by the user": lambda: Fault(part="host", user_stops=True),
    "gripper 10 times too slow": lambda: Fault(part="servo", speed_factor=0.1),
    "object beside the sheet, current absent": lambda: Fault(
        part="two at once",
        corrupt=_hold_first_counts,
        alter_state=_replace_values(current_ma=math.nan),
    ),
    "pressed from outside, finger at rest": lambda: Fault(
        part="two at once", pushed_mm=4.0, alter_state=_repeat_first_state, corrupt=_hold_one_finger
    ),
    "too fast, moving flag flickers": lambda: Fault(
        part="two at once", speed_factor=10.0, alter_state=_flicker_moving()
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
        """Return the next frame, with the fault applied."""
        fault = self.fault
        if fault is not None and fault.port_lost:
            raise DeviceError("port /dev/ttyUSB0 vanished; plug it in again")
        if fault is not None and fault.no_frames:
            self._clock.sleep_s(timeout_s)
            raise DeviceTimeoutError(f"no frame in {timeout_s:.2f} s; check the cable")
        frame = self._array.read(timeout_s=timeout_s)
        if self._first is None:
            self._first = frame.counts
        if fault is None:
            return frame
        if fault.delay_s:
            self._clock.sleep_s(fault.delay_s)
        if fault.time_jump_s and frame.sequence % 2:
            frame = replace(frame, time_s=frame.time_s - fault.time_jump_s)
        if fault.corrupt is None:
            return frame
        return replace(frame, counts=fault.corrupt(frame.counts.copy(), self._first))

    def close(self) -> None:
        """Stop scanning."""
        self._array.close()


class FaultyGripper:
    """The twin's gripper until `fault` is set."""

    def __init__(self, world: World) -> None:
        self._gripper, self._world = TwinGripper(world), world
        self._first: GripperState | None = None
        self.fault: Fault | None = None
        #: Duration of the last movement commanded, seconds.
        self.movement_s = 0.0

    @property
    def limits(self) -> GripperLimits:
        """Range and drive."""
        return self._gripper.limits

    def state(self) -> GripperState:
        """Return the state, with the fault applied."""
        fault = self._require_reply()
        state = self._gripper.state()
        if fault is None or fault.alter_state is None:
            return state
        self._first = self._first or state
        other = fault.alter_state(state, self._first)
        if self.limits.drive == "width":
            return replace(other, pressure_kpa=math.nan)
        return replace(other, width_mm=math.nan, current_ma=math.nan)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send a command, altered by the fault; return the unaltered command."""
        fault, limits = self._require_reply(), self.limits
        now = self._world.drive_value(self._world.clock.now_s())
        self.movement_s = abs(wanted.target - now) / wanted.rate
        closing = limits.target(limits.span)
        if fault is not None and fault.does_not_move:
            return wanted
        if fault is not None and fault.closes_fully and wanted.target != limits.target(0.0):
            self._gripper.command(replace(wanted, target=closing))
            return wanted
        if fault is not None and fault.speed_factor != 1.0:
            sent = self._gripper.command(wanted)
            self._world.drive(sent.target, rate=fault.speed_factor * sent.rate)
            return sent
        return self._gripper.command(wanted)

    def stop(self) -> None:
        """Stop; soft fingers vent, as with their driver."""
        self._require_reply()
        if self.limits.drive == "pressure":
            self._gripper.release()
        else:
            self._gripper.stop()

    def release(self) -> None:
        """Open."""
        self._gripper.release()

    def close(self) -> None:
        """Do nothing."""

    def _require_reply(self) -> Fault | None:
        if self.fault is not None and self.fault.no_reply:
            raise DeviceTimeoutError("the gripper does not reply; check its power")
        return self.fault


def inject_fault(
    fault: Fault, *, world: World, array: FaultyArray, gripper: FaultyGripper, requests: Requests
) -> None:
    """Let a fault happen now, in devices of a world and on the side of host and user."""
    array.fault = gripper.fault = fault
    world.clock.sleep_s(fault.hang_s)
    if fault.pushed_mm and gripper.limits.drive == "width":
        gripper.state()
        world.drive(world.drive_value(world.clock.now_s()) - fault.pushed_mm, rate=60.0)
    if fault.user_stops:
        requests.stop.set()
