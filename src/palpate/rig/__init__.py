"""Rigs by name or by rig file: an array, a gripper, a clock and the calibration that fits them.

A rig is opened by a function `open(*, object_name, seed) -> Rig`. Built-in ones are rows of
`BUILT_IN`; other packages add theirs as entry points of the group `palpate.rigs`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from palpate.clock import Clock
from palpate.errors import DeviceError, InputError
from palpate.gripper.interface import Gripper
from palpate.recording.contents import Origin
from palpate.sensor.array import PressureArray
from palpate.sensor.calibration import Calibration

ENTRY_POINTS = "palpate.rigs"

#: Name -> module and function that opens it; imported only when asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "sim-rigid": ("palpate.rig.simulated", "open_rigid"),
    "sim-soft": ("palpate.rig.simulated", "open_soft"),
    "sim-firmware": ("palpate.rig.simulated", "open_firmware"),
}
DEFAULT_RIG = "sim-rigid"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Devices that belong together, open.

    Attributes
    ----------
    name : str
        As asked for.
    array, gripper, clock
        The devices, and the clock that their times are on.
    calibration : Calibration
        Made with this sensor on this gripper.
    origin : {"hardware", "firmware-simulated", "twin"}
        Where the frames come from; every result of a simulated rig must state it.
    subject : str or None
        What lies between the fingers, where the rig knows.
    truth : callable or None
        The twin's own values; on simulated rigs only.
    """

    name: str
    array: PressureArray
    gripper: Gripper
    clock: Clock
    calibration: Calibration
    origin: Origin = "hardware"
    subject: str | None = None
    truth: Callable[[], Mapping[str, object]] | None = None

    @property
    def simulated(self) -> bool:
        """Whether any of it is simulated."""
        return self.origin != "hardware"

    def close(self) -> None:
        """Let go of the devices."""
        self.array.close()
        self.gripper.close()


def rig_names() -> tuple[str, ...]:
    """Return the names of the rigs that can be asked for: built in first, then other packages'."""
    others = sorted(point.name for point in entry_points(group=ENTRY_POINTS))
    return (*BUILT_IN, *(name for name in others if name not in BUILT_IN))


def open_rig(name: str = DEFAULT_RIG, *, object_name: str | None = None, seed: int = 0) -> Rig:
    """Open a rig.

    Parameters
    ----------
    name : str
        Name of a rig, or path of a rig file (ending in .toml).
    object_name : str, optional
        For simulated rigs: what lies between the fingers; drawn by the seed by default.
    seed : int
        For simulated rigs: decides everything that chance does.

    Raises
    ------
    InputError
        If there is no such rig or object, or the rig file is at fault.
    DeviceError
        If the equipment, or what simulates it, isn't there.
    """
    if name.endswith(".toml"):
        from palpate.rig.file import open_file

        return open_file(Path(name), object_name=object_name, seed=seed)
    if name in BUILT_IN:
        module_name, function = BUILT_IN[name]
        try:
            module = importlib.import_module(module_name)
        except ModuleNotFoundError as error:
            if error.name != module_name:
                raise
            raise DeviceError(
                f"rig {name!r} is not part of this installation; "
                "install palpate with its firmware tools, or use --rig sim-rigid"
            ) from error
        opener: Callable[..., Rig] = getattr(module, function)
        return opener(object_name=object_name, seed=seed)
    for point in entry_points(group=ENTRY_POINTS):
        if point.name == name:
            rig: Rig = point.load()(object_name=object_name, seed=seed)
            return rig
    raise InputError(
        f"no rig {name!r}; there are: {', '.join(rig_names())}, or a rig file (*.toml)"
    )
