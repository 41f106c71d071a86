"""A sensor without a gripper: what `palpate init --gripper none` describes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from palpate.clock import Clock, RealClock
from palpate.errors import CalibrationError
from palpate.recording.contents import Origin
from palpate.rig import Rig, open_rig
from palpate.rig.file import check_layout, open_stated, read_stated
from palpate.sensor.array import PressureArray
from palpate.sensor.calibration import Calibration


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorRig:
    """An open array with its clock; it has a `Rig`'s fields but no gripper."""

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
    def is_simulated(self) -> bool:
        """Whether any of it is simulated."""
        return self.origin != "hardware"

    def close(self) -> None:
        """Close the sensor."""
        self.array.close()


def open_rig_or_sensor(name: str, *, object_name: str | None = None, seed: int) -> Rig | SensorRig:
    """Open a rig as `open_rig` does, or the sensor of a rig file without gripper."""
    path = Path(name)
    stated = read_stated(path) if name.endswith(".toml") else {"use": name}
    if "use" in stated or "gripper" in stated:
        return open_rig(name, object_name=object_name, seed=seed)
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
