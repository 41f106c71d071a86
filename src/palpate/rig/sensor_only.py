"""A sensor without a gripper, as described by a file of `palpate init --gripper none`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from palpate.calibration import Calibration
from palpate.clock import Clock, RealClock
from palpate.errors import CalibrationError
from palpate.recording.contents import Origin
from palpate.rig import Rig, open_rig
from palpate.rig.file import check_layout, find_calibration_file, open_device, read_rig_table
from palpate.sensor.array import PressureArray


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorRig:
    """An open array with its clock; the fields are those of `Rig`, without a gripper."""

    #: Name or file as passed to `open_rig_or_sensor`.
    name: str
    array: PressureArray
    clock: Clock
    #: Calibration of this sensor; None before its rest is calibrated.
    calibration: Calibration | None
    origin: Origin = "hardware"
    gripper: None = None
    subject: None = None
    truth: Callable[[], Mapping[str, object]] | None = None

    @property
    def is_simulated(self) -> bool:
        """Whether the sensor is simulated."""
        return self.origin != "hardware"

    def close(self) -> None:
        """Close the sensor."""
        self.array.close()


def open_rig_or_sensor(
    name: str, *, object_name: str | None = None, seed: int, rate_hz: float | None = None
) -> Rig | SensorRig:
    """Open a rig, or only the sensor of a rig file without a gripper."""
    path = Path(name)
    stated = read_rig_table(path) if name.endswith(".toml") else {"use": name}
    if "use" in stated or "gripper" in stated:
        return open_rig(name, object_name=object_name, seed=seed, rate_hz=rate_hz)
    file, calibration = find_calibration_file(path), None
    array: PressureArray = open_device(path, "array", stated.get("array"))
    try:
        if file is not None and file.is_file():
            calibration = Calibration.load(file)
            check_layout(calibration, array, file=file, rig_file=path)
    except CalibrationError:
        array.close()
        raise
    return SensorRig(name=path.name, array=array, clock=RealClock(), calibration=calibration)
