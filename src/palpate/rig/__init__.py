"""Rigs (array, gripper, clock and calibration), opened by name or rig file.

Named rigs are entry points of the group `palpate.rigs`, each a function
`open(*, object_name, seed) -> Rig`. Those of `BUILT_IN` are simulated, and take `rate_hz`, too.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self, cast

from palpate.calibration import Calibration
from palpate.clock import Clock, RealClock
from palpate.errors import CalibrationError, InputError, PalpateError
from palpate.gripper.interface import Gripper
from palpate.gripper.no_gripper import NoGripper
from palpate.gripper.plain import MovedByWidth, PlainGripper
from palpate.recording.contents import Origin
from palpate.sensor.array import PressureArray, read_waiting

if TYPE_CHECKING:
    from palpate.rig.grip import Grip
    from palpate.rig.reading import Reader, Reading

ENTRY_POINTS = "palpate.rigs"

BUILT_IN = ("sim-rigid", "sim-soft", "sim-firmware")
DEFAULT_RIG = BUILT_IN[0]
#: Timeout for a frame, seconds; the slowest board sends about 15 frames per second.
_FRAME_S = 1.0


@dataclass(slots=True, kw_only=True, eq=False, repr=False)
class Rig:
    """Open devices of one rig; a `with` block releases the object and closes the devices.

    Attributes
    ----------
    name : str
        Name or file as passed to `open_rig`.
    array, gripper, clock
        The devices, and the clock of their timestamps.
    calibration : Calibration
        Calibration of this sensor on this gripper.
    origin : {"hardware", "firmware-simulated", "twin"}
        Source of the frames; every result of a simulated rig must state its origin.
    subject : str or None
        The object between the fingers, if known.
    truth : callable or None
        Returns the twin's true values; only on simulated rigs.
    seed : int or None
        Seed of a simulated rig's random variation.
    place_object : callable or None
        Places the n-th object of the seed and of the same kind between the open fingers; only on
        simulated rigs. The first object is there already.

    Examples
    --------
    >>> with open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
    ...     grip = rig.grasp(target_force_n=2.0)
    ...     held = grip.is_holding
    ...     result = grip.release()
    >>> held, str(result.outcome)
    (True, 'held')
    """

    name: str
    array: PressureArray
    gripper: Gripper
    clock: Clock
    calibration: Calibration
    origin: Origin = "hardware"
    subject: str | None = None
    truth: Callable[[], Mapping[str, object]] | None = None
    seed: int | None = None
    place_object: Callable[[int], None] | None = None
    _reader: Reader | None = field(default=None, init=False)
    _grip: Grip | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Arm the pixel ceiling that the board enforces itself; close the devices on failure."""
        from palpate.grasp.pixel_ceiling import ceiling_counts
        from palpate.sensor.serial_array import SerialArray

        if not isinstance(self.array, SerialArray):
            return
        try:
            self.array.arm_ceiling(ceiling_counts(self.calibration))
        except PalpateError:
            self.close()
            raise

    @property
    def is_simulated(self) -> bool:
        """Whether any part of the rig is simulated."""
        return self.origin != "hardware"

    @property
    def has_force(self) -> bool:
        """Whether the calibration has a force law."""
        return self._get_reader().has_force

    def read(self, *, timeout_s: float = _FRAME_S) -> Reading:
        """Return the newest frame as a reading, without moving the gripper.

        After a pause the frames in between are skipped; `for reading in rig` yields every frame.
        Each frame is returned once: a call in quick succession waits for the next frame.

        `timeout_s`: time limit for a frame.
        Raises `DeviceError` if no frame arrives, or the running grasp ends.
        """
        if self._grip is not None and self._grip.is_holding:
            return self._grip.read()
        # The first reader fits the force law, while which frames grow old.
        reader = self._get_reader()
        *earlier, newest = read_waiting(self.array, clock=self.clock, timeout_s=timeout_s)
        reader.follow(earlier)
        return reader.read(newest, now_s=self.clock.now_s())

    def __iter__(self) -> Iterator[Reading]:
        """Yield every frame in order as a reading; see `read`."""
        reader = self._get_reader()
        while True:
            if self._grip is not None and self._grip.is_holding:
                yield self._grip.read()
            else:
                frame = self.array.read(timeout_s=_FRAME_S)
                yield reader.read(frame, now_s=self.clock.now_s())

    def grasp(
        self,
        *,
        target_force_n: float | None = None,
        expect_size_mm: float | None = None,
        damage: str | os.PathLike[str] | None = None,
        kind: str | None = None,
        tighten: int = 0,
        record: str | os.PathLike[str] | None = None,
        method: Literal["palpate", "paper"] = "palpate",
        step_mm: float | None = None,
        epsilon_percent: float | None = None,
        extra_mm: float | None = None,
        cutoff_s: float | None = None,
    ) -> Grip:
        """Grasp, and return once the object is held or the attempt has ended.

        The control loop continues to guard a held object until `Grip.release`.

        Parameters
        ----------
        target_force_n : float, optional
            Grip force to reach, newtons; a gentle squeeze by default.
        expect_size_mm : float, optional
            Approximate size of the object, mm, for a faster approach.
        damage : path, optional
            File of `palpate calibrate damage`; the force stays below its damage limit.
        kind : str, optional
            With `damage`: kind of produce, if known.
        tighten : int
            Largest number of times that the hand tightens the grip when the held object slips,
            each recorded as the moment ``tightened``; it never tightens by default.
        record : path, optional
            New .mcap file for every frame until release.
        method : str
            ``paper`` follows the paper's procedure: fixed steps to contact, an exponential fit, a
            linear force law. It has neither a target force nor an expected size.
        step_mm, epsilon_percent, extra_mm, cutoff_s : float, optional
            Settings of the paper's method (`palpate.grasp.paper.Paper`).

        Raises
        ------
        InputError
            If an option is invalid, or an object is already held.
        CalibrationError
            If the calibration lacks data that a grasp needs.
        RecordingError
            If the recording exists or can't be created. A recording that can't be written later is
            a fault of the result, and `Grip.release` raises `RecordingLostError`.
        """
        from palpate.grasp.damage_limit import load_limit
        from palpate.grasp.paper import read_settings
        from palpate.rig.grip import Grip
        from palpate.rig.job import GraspJob
        from palpate.rig.paced_array import PacedArray

        if self._grip is not None and self._grip.is_holding:
            raise InputError("an object is already held; release it first (`Grip.release`)")
        settings = {
            "step_mm": step_mm,
            "epsilon_percent": epsilon_percent,
            "extra_mm": extra_mm,
            "cutoff_s": cutoff_s,
        }
        paced = PacedArray(self.array, speed=math.inf) if self.is_simulated else None
        job = GraspJob(
            self,
            target_force_n=target_force_n,
            expect_size_mm=expect_size_mm,
            limit=load_limit(damage, kind=kind),
            paper=read_settings(method, settings, names={}),
            record=None if record is None else Path(record),
            tighten=tighten,
            array=paced,
            hold_s=math.inf,
        )
        self._grip = Grip(job, reader=self._get_reader(), clock=self.clock, paced=paced)
        self._grip.start()
        return self._grip

    def close(self) -> None:
        """Release a held object and close the devices."""
        try:
            if self._grip is not None:
                self._grip.release()
        finally:
            self.array.close()
            self.gripper.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if error is not None and self._grip is not None:
                # An error in a script must not drop the object.
                self._grip.stop()
        finally:
            self.close()

    def __repr__(self) -> str:
        parts = [repr(self.name), "simulated" if self.is_simulated else "hardware", self.subject]
        return f"Rig({', '.join(part for part in parts if part)})"

    def _get_reader(self) -> Reader:
        from palpate.rig.reading import Reader

        if self._reader is None:
            self._reader = Reader(self.calibration)
        return self._reader


def rig_names() -> tuple[str, ...]:
    """Return the names of the available rigs: built-in rigs, then those of other packages."""
    others = sorted(point.name for point in entry_points(group=ENTRY_POINTS))
    return (*BUILT_IN, *(name for name in others if name not in BUILT_IN))


def open_rig(
    name: str = DEFAULT_RIG,
    *,
    object_name: str | None = None,
    seed: int = 0,
    rate_hz: float | None = None,
    array: PressureArray | None = None,
    gripper: Gripper | MovedByWidth | None = None,
    calibration: Calibration | str | os.PathLike[str] | None = None,
) -> Rig:
    """Open a rig by its name or file, or one made of Python objects.

    Parameters
    ----------
    name : str
        Name of a rig, or path of a rig file (.toml).
    object_name : str, optional
        Object between the fingers of a simulated rig; drawn with the seed by default.
    seed : int
        Seed of all random variation of a simulated rig.
    rate_hz : float, optional
        Frame rate of a built-in simulated rig; 250 by default, as with palpate's firmware.
    array : PressureArray, optional
        Your own sensor, with its `calibration`; `name` is then a label.
    gripper : Gripper or MovedByWidth, optional
        Your own gripper, for your own sensor or for a rig file: palpate's interface, or any object
        with `width_mm`, `move(width_mm, speed_mm_s)` and `stop()`.
    calibration : Calibration or path, optional
        Calibration of `array`.

    Raises
    ------
    InputError
        If the rig or the object is unknown, the rig file is invalid, `rate_hz` is given for
        another rig, or your objects do not fit.
    DeviceError
        If the equipment or its simulator is not available.
    """
    hand = None if gripper is None else _as_gripper(gripper)
    if array is not None:
        return _open_objects(name, array=array, gripper=hand, calibration=calibration)
    if calibration is not None:
        raise InputError("calibration=... belongs to array=...; a rig file names its own")
    if hand is not None and not name.endswith(".toml"):
        raise InputError(f"gripper=... needs a rig file or array=...; {name} has its own gripper")
    if name in BUILT_IN:
        return _open_entry(name, object_name=object_name, seed=seed, rate_hz=rate_hz)
    if rate_hz is not None:
        raise InputError(
            f"a frame rate can be given for {', '.join(BUILT_IN)} only; the rate of {name} is "
            "that of its rig file or its board"
        )
    if name.endswith(".toml"):
        from palpate.rig.file import open_file

        return open_file(Path(name), object_name=object_name, seed=seed, gripper=hand)
    return _open_entry(name, object_name=object_name, seed=seed)


def _open_entry(name: str, **options: Any) -> Rig:
    """Open a rig of an entry point."""
    for point in entry_points(group=ENTRY_POINTS):
        if point.name == name:
            rig: Rig = point.load()(**options)
            return rig
    raise InputError(
        f"no rig {name!r}; available: {', '.join(rig_names())}, or a rig file (*.toml)"
    )


def _as_gripper(hand: Gripper | MovedByWidth) -> Gripper:
    """Return an object as a gripper; palpate's interface has `limits`."""
    if hasattr(hand, "limits"):
        return cast(Gripper, hand)
    return PlainGripper(hand)


def _open_objects(
    name: str,
    *,
    array: PressureArray,
    gripper: Gripper | None,
    calibration: Calibration | str | os.PathLike[str] | None,
) -> Rig:
    """Return a rig of a user's objects."""
    if calibration is None:
        raise InputError("array=... needs calibration=FILE, from `palpate calibrate`")
    made = calibration
    if not isinstance(made, Calibration):
        made = Calibration.load(Path(made))
    if difference := made.layout.describe_difference(array.layout):
        raise CalibrationError(
            f"the calibration belongs to another sensor ({difference}); calibrate this array"
        )
    return Rig(
        name="your objects" if name in BUILT_IN else name,
        array=array,
        gripper=NoGripper() if gripper is None else gripper,
        clock=RealClock(),
        calibration=made,
    )
