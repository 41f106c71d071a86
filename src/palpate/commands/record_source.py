"""Sources of `palpate record`: a board on a port, or a rig with its gripper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.clock import Clock, RealClock
from palpate.errors import InputError
from palpate.gripper.interface import GripperState
from palpate.recording import LoadCells, RecordingInfo
from palpate.rig import open_rig
from palpate.rig.recorded import clock_zero_unix_ns, firmware_version, recording_info
from palpate.rig.sensor_only import names_no_gripper, open_sensor
from palpate.sensor.array import PressureArray, link_counters
from palpate.sensor.board_array import open_board
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import NO_READING
from palpate.version import __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordSource:
    """Something open that gives frames."""

    #: For the user.
    name: str
    #: The sensor.
    array: PressureArray
    #: What its times are on.
    clock: Clock
    #: The description that the recording will carry.
    info: RecordingInfo
    #: Gives the gripper's state; None without a gripper.
    gripper: Callable[[], GripperState | None] = lambda: None
    _cells_seen: list[int] = field(default_factory=list)

    def load_cells(self) -> LoadCells | None:
        """Give each new pair of load-cell readings once."""
        if not isinstance(self.array, SerialArray):
            return None
        cells = self.array.load_cells
        samples = [cell.sample for cell in cells]
        if samples == self._cells_seen or all(cell.raw == NO_READING for cell in cells):
            return None
        self._cells_seen[:] = samples
        return LoadCells(time_s=self.array.newest_s, raw=tuple(cell.raw for cell in cells))

    def link_text(self) -> str:
        """Report what happened on the link, if there is one."""
        count = link_counters(self.array)
        if count is None:
            return "recorded"
        return (
            f"{count.frames} frames, {count.lost} lost, {count.corrupt} corrupt, "
            f"{count.late} late, {count.reconnects} reconnects"
        )


def board_source(given: Mapping[str, Any], *, stack: ExitStack) -> RecordSource:
    """Open the board on a port; `given` goes to `open_board`, and `stack` closes it.

    Raises `InputError` if there is no such layout; `DeviceError` if there is no board, it does not
    answer, or it can't do that rate.
    """
    array = open_board(**given)
    stack.callback(array.close)
    info = RecordingInfo(
        layout=array.layout,
        origin="hardware",
        firmware_version=firmware_version(array),
        versions={"palpate": __version__},
        clock_zero_unix_ns=clock_zero_unix_ns(),
    )
    return RecordSource(name=array.name, array=array, clock=RealClock(), info=info)


def rig_source(
    name: str, given: Mapping[str, Any], *, stack: ExitStack, seed: int, endless: bool
) -> RecordSource:
    """Open a rig with its gripper, where it has one; `stack` closes it.

    Raises `InputError` if there is no such rig, an option contradicts it, or simulated time would
    never end; `CalibrationError` if its calibration is of another sensor; `DeviceError` if the
    equipment isn't there.
    """
    if given:
        option = next(iter(given)).replace("_", "-")
        raise InputError(f"--{option}: a rig states that itself; leave it out with --rig")
    if name.endswith(".toml") and names_no_gripper(Path(name)):
        sensor = open_sensor(Path(name))
        stack.callback(sensor.close)
        return RecordSource(
            name=name, array=sensor.array, clock=sensor.clock, info=recording_info(sensor, seed=0)
        )
    rig = open_rig(name, seed=seed)
    stack.callback(rig.close)
    if rig.simulated and endless:
        raise InputError(f"--rig {name} is simulated and would never end: give a --duration")
    return RecordSource(
        name=f"{name} (simulated)" if rig.simulated else name,
        array=rig.array,
        clock=rig.clock,
        info=recording_info(rig, seed=seed),
        gripper=rig.gripper.state,
    )
