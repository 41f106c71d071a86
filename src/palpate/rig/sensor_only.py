"""A sensor without a gripper: what `palpate init --gripper none` describes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from palpate.clock import Clock, RealClock
from palpate.errors import CalibrationError
from palpate.recording.contents import Origin
from palpate.rig.file import check_layout, open_stated, read_stated
from palpate.sensor.array import PressureArray
from palpate.sensor.calibration import Calibration


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorRig:
    """An open array with its clock; it has the fields of a `Rig`, and nothing that moves."""

    #: As asked for.
    name: str
    array: PressureArray
    clock: Clock
    #: Made with this sensor; None before the rest was calibrated.
    calibration: Calibration | None
    origin: Origin = "hardware"
    gripper: None = None
    subject: None = None
    truth: Callable[[], Mapping[str, object]] | None = None

    @property
    def simulated(self) -> bool:
        """Whether any of it is simulated."""
        return self.origin != "hardware"

    def close(self) -> None:
        """Let go of the sensor."""
        self.array.close()


def names_no_gripper(path: Path) -> bool:
    """Return whether a rig file describes a sensor alone.

    Raises `InputError` if it can't be read.
    """
    stated = read_stated(path)
    return "use" not in stated and "gripper" not in stated


def open_sensor(path: Path) -> SensorRig:
    """Open the sensor of a rig file that names no gripper.

    Raises `InputError` if the file lacks or misnames something; `CalibrationError` if the
    calibration can't be read, or is of another sensor; `DeviceError` if the sensor isn't there.
    """
    stated = read_stated(path)
    array: PressureArray = open_stated(path, "array", stated.get("array"))
    file, calibration = path.parent / str(stated.get("calibration", "")), None
    try:
        if file.is_file():
            calibration = Calibration.load(file)
            check_layout(calibration, array, file=file, rig_file=path)
    except CalibrationError:
        array.close()
        raise
    return SensorRig(name=path.name, array=array, clock=RealClock(), calibration=calibration)
