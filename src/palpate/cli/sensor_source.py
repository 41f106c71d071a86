"""Frame sources for commands: a rig, a rig file or a board."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.calibration import Calibration
from palpate.cli.options import resolve_rig
from palpate.errors import CalibrationError, DeviceTimeoutError
from palpate.gripper.interface import Gripper
from palpate.rig import open_rig
from palpate.rig.file import find_calibration_file, find_ports, open_device, read_rig_table
from palpate.sensor.array import FRAME_TIMEOUT_S, LinkCounters, PressureArray, get_link_counters
from palpate.sensor.board_array import open_board
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.serial_array import SerialArray


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSource:
    """An open array with its origin and calibration."""

    #: Name for titles.
    name: str
    #: The open sensor.
    array: PressureArray
    #: Calibration of a complete rig.
    calibration: Calibration | None = None
    #: Calibration file named by a rig file; may not exist yet.
    calibration_path: Path | None = None
    #: Gripper of a simulated rig, to squeeze its object.
    gripper: Gripper | None = None
    #: Whether the frames are simulated.
    simulated: bool = False
    #: Serial ports of the sensor and of its rig file.
    ports: tuple[str, ...] = ()

    @property
    def requested_rate_hz(self) -> float | None:
        """The frame rate requested from the board; None without a board."""
        board = self.array.identity if isinstance(self.array, SerialArray) else None
        return None if board is None else board.rate_hz

    def link_counters(self) -> LinkCounters:
        """Return the counters of the link; zeros for a source without one."""
        return get_link_counters(self.array) or LinkCounters()

    def rest_ohm(self) -> NDArray[np.float64] | None:
        """Return the calibrated rest values, shape (rows, cols); None without a calibration.

        Raises `CalibrationError` like `find_calibration`.
        """
        calibration = self.find_calibration()
        return None if calibration is None else calibration.rest_ohm

    def find_calibration(self) -> Calibration | None:
        """Return the sensor's calibration; None if there is none yet.

        Raises `CalibrationError` if the file can't be read or is for a sensor with a different
        layout.
        """
        calibration, layout = self.calibration, self.array.layout
        if calibration is None and self.calibration_path and self.calibration_path.exists():
            calibration = Calibration.load(self.calibration_path)
        if calibration is None:
            return None
        if difference := calibration.layout.describe_difference(layout):
            raise CalibrationError(
                f"the calibration belongs to another sensor ({difference}); "
                "fix the rig file, or run `palpate calibrate rest --new`"
            )
        return calibration

    def frames(self, duration_s: float) -> FrameColumns:
        """Read frames for a duration on the sensor's clock.

        Raises `DeviceError` if the sensor is disconnected, or silent before the second frame.
        """
        taken = [self.array.read(timeout_s=FRAME_TIMEOUT_S)]
        while taken[-1].time_s - taken[0].time_s < duration_s:
            try:
                taken.append(self.array.read(timeout_s=FRAME_TIMEOUT_S))
            except DeviceTimeoutError:
                if len(taken) < 2:
                    raise
                break
        return FrameColumns.from_frames(taken)

    def close(self) -> None:
        """Release the devices."""
        self.array.close()
        if self.gripper is not None:
            self.gripper.close()


def open_source(rig: str | None = None, *, port: str | None = None) -> SensorSource:
    """Open the sensor of a rig without its gripper, or of a board.

    `rig`: name of a rig, or a rig file. Without rig and port, ./rig.toml or $PALPATE_RIG.
    `port`: serial port of a board with the defaults of `palpate.sensor.board_array.open_board`.
    Raises `InputError` if the rig is invalid, or both are given; `DeviceError` if the equipment is
    missing.
    """
    rig = resolve_rig(rig, port)
    if rig is None:
        opened = open_board(port=port)
        ports = tuple(find_ports(None, array=opened))
        return SensorSource(name=opened.name, array=opened, ports=ports)
    if rig.endswith(".toml"):
        path = Path(rig)
        stated = read_rig_table(path)
        if "use" not in stated:
            array: PressureArray = open_device(path, "array", stated.get("array"))
            # The calibration file may not exist yet.
            place = find_calibration_file(path)
            return SensorSource(
                name=path.name,
                array=array,
                calibration_path=place,
                ports=tuple(find_ports(rig, array=array)),
            )
    devices = open_rig(rig)
    return SensorSource(
        name=devices.name,
        array=devices.array,
        calibration=devices.calibration,
        gripper=devices.gripper if devices.is_simulated else None,
        simulated=devices.is_simulated,
    )
