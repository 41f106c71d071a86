"""Simulated rigs: rigid fingers, soft fingers, and rigid fingers with the real firmware."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import lru_cache, partial
from itertools import chain
from typing import Protocol

import numpy as np

from palpate.calibrate.guided import Bench, measure_block, measure_force, measure_rest
from palpate.calibrate.servo_current import measure_current, measure_gear_friction
from palpate.calibration import BlockPairs, Calibration, CurrentPairs, join_currents
from palpate.errors import DeviceError, InputError
from palpate.force.of_calibration import DWELL_S, HORIZON_S, fit_sheet_law
from palpate.rig import Rig
from palpate.rig.bench import GuidedBench
from palpate.sensor.array import PressureArray
from palpate.sensor.board_array import check_rate
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.firmware import open_firmware_array
from palpate.twin.objects import OBJECTS, TwinObject, draw_object
from palpate.twin.ranges import ranges_of
from palpate.twin.stage import Stage
from palpate.twin.velostat import Sheet
from palpate.twin.world import GripperKind, World

#: Faces mounted on the load cell in turn: flat and round, soft and stiff.
FACES = (
    "ball-44lbs",
    "dragonskin-20",
    "ball-66lbs",
    "springs-8",
    "ball-33lbs",
    "dragonskin-10",
    "springs-4",
    "ecoflex-10",
)
#: Number of these faces used in the calibration of a built-in rig.
_FACE_COUNT = 6
#: Offset from the seed of a grasp to the seed of the session that calibrates its rig.
CALIBRATION_SEED_OFFSET = 1_000_003
_BLOCK_MM, _LARGER_MM, _BLOCK_N, _BLOCK_REPEATS = 40.0, 50.0, 15.0, 3


class Workplace(Stage, Protocol):
    """A simulated world for calibration, in which the object can be replaced."""

    def stop_sheet(self) -> None:
        """Stop computing the sheet, to save time; all counts are 0 from now on."""
        ...

    def place(self, obj: TwinObject | None) -> None:
        """Replace the object between the open fingers with another object, or remove it."""
        ...


#: Calibration of each kind of gripper: width or pressure before contact with any face (none is
#: larger than 51 mm), and the forces of the holds in each placement of the cell, small and large
#: mixed, within the range of the gripper.
_START_POSITION: dict[GripperKind, float] = {"rigid": 51.0, "soft": 15.0}
_HOLDS_N: dict[GripperKind, tuple[tuple[float, ...], ...]] = {
    "rigid": ((0.5, 2.5), (1, 5), (0.8, 3.5), (1.5, 9), (1.2, 4), (2.5, 15), (0.4, 1.8)),
    "soft": ((0.4, 3), (0.8, 5), (0.3, 2), (1.5, 6), (1.2, 4), (2.5, 7), (0.5, 1.8)),
}
#: Scatter of the sheets and grippers of the built-in rigs.
_LEVEL = "lab"
#: Default frame rate of the built-in rigs, Hz: that of palpate's firmware. The paper's board
#: sends 15.
_FRAME_RATE_HZ = 250.0


def open_rigid(*, object_name: str | None, seed: int, rate_hz: float | None = None) -> Rig:
    """Open `sim-rigid`: rigid fingers driven by width, with an object between them.

    `object_name`: one of `palpate.twin.objects.OBJECTS`; None draws one with the seed.
    `rate_hz`: frames per second; that of palpate's firmware by default.
    Raises `InputError` if the object is unknown or the rate unusable.
    """
    return _open("sim-rigid", object_name=object_name, seed=seed, rate_hz=rate_hz)


def open_soft(*, object_name: str | None, seed: int, rate_hz: float | None = None) -> Rig:
    """Open `sim-soft`: soft fingers driven by pressure; see `open_rigid`."""
    return _open("sim-soft", object_name=object_name, seed=seed, rate_hz=rate_hz)


def open_firmware(*, object_name: str | None, seed: int, rate_hz: float | None = None) -> Rig:
    """Open `sim-firmware`: rigid fingers, read by the firmware on the AVR simulator.

    Parameters and errors as `open_rigid`.
    Raises `DeviceNotFoundError` if the firmware or the simulator has not been built.
    """
    return _open("sim-firmware", object_name=object_name, seed=seed, rate_hz=rate_hz)


def _open(name: str, *, object_name: str | None, seed: int, rate_hz: float | None) -> Rig:
    if object_name is not None and object_name not in OBJECTS:
        raise InputError(f"no simulated object {object_name!r}; available: {', '.join(OBJECTS)}")
    rate_hz = _FRAME_RATE_HZ if rate_hz is None else rate_hz
    check_rate(rate_hz)
    kind: GripperKind = "soft" if name == "sim-soft" else "rigid"
    obj = draw_object(np.random.default_rng([seed, 10]), object_name)
    world = World(
        obj, seed=seed, sheet_seed=seed, level=_LEVEL, gripper=kind, frame_rate_hz=rate_hz
    )
    by_firmware = name == "sim-firmware"
    return Rig(
        name=name,
        array=read_through_firmware(world) if by_firmware else TwinArray(world),
        gripper=TwinGripper(world),
        clock=world.clock,
        calibration=calibrate_twin(seed=seed, level=_LEVEL, apart_from=obj.name, kind=kind),
        origin="firmware-simulated" if by_firmware else "twin",
        subject=obj.name,
        truth=lambda: world.truth().to_dict(),
        seed=seed,
    )


def calibrate_twin(
    *,
    seed: int,
    level: str,
    apart_from: str,
    kind: GripperKind = "rigid",
    replace_sheet: Callable[[Sheet], Sheet] | None = None,
) -> Calibration:
    """Calibrate the sensor and gripper of a seed in a session separate from the grasp.

    The steps are those of a user: rest, a load cell with several faces, a rigid block. The
    calibration uses no true values of the twin. The object to be grasped (`apart_from`) is not
    among the faces. `replace_sheet`: as in `World`.
    """
    # The name of an object that is not among the faces has no effect.
    apart_from = apart_from if apart_from in FACES[:_FACE_COUNT] else ""
    return _calibrate_seed(seed, level, apart_from, kind, replace_sheet)


# A calibration takes as long as a grasp, and a process often opens the same rig again.
@lru_cache(maxsize=64)
def _calibrate_seed(
    seed: int,
    level: str,
    apart_from: str,
    kind: GripperKind,
    replace_sheet: Callable[[Sheet], Sheet] | None,
) -> Calibration:
    world = World(
        None,
        seed=seed + CALIBRATION_SEED_OFFSET,
        sheet_seed=seed,
        level=level,
        gripper=kind,
        replace_sheet=replace_sheet,
    )
    return calibrate_world(world, seed=seed, apart_from=apart_from, sensor_id=f"twin-{seed}")


def calibrate_world(world: Workplace, *, seed: int, apart_from: str, sensor_id: str) -> Calibration:
    """Calibrate the sensor and gripper of a world with a user's steps (`calibrate_twin`).

    `world`: a world without an object between the fingers.
    `seed`: seed of the load cell's faces.
    `apart_from`: name of an object to exclude from the faces.
    `sensor_id`: name of the sensor in the calibration.
    """
    rng = np.random.default_rng([seed, 11])
    faces = [name for name in FACES[:_FACE_COUNT] if name != apart_from]

    def face(run: int) -> TwinObject:
        return draw_object(rng, faces[run % len(faces)])

    bench = twin_bench(world, start=_START_POSITION[world.gripper])
    rest = measure_rest(bench)
    force = measure_force(
        bench,
        holds_n=_HOLDS_N[world.gripper],
        reseat=lambda run: world.place(face(run)),
        dwell_s=DWELL_S,
        horizon_s=HORIZON_S,
    )
    # The remaining steps read only the load cell, the width and the current.
    world.stop_sheet()
    world.place(draw_object(rng, "rigid-block"))
    closing = partial(
        measure_block, bench, up_to_n=_BLOCK_N, repeats=_BLOCK_REPEATS, dwell_s=DWELL_S
    )
    block = closing(block_mm=_BLOCK_MM)
    current = None
    if world.gripper == "rigid":
        current = _calibrate_current(bench, world)
    else:
        larger = draw_object(rng, "rigid-block")
        world.place(replace(larger, size_mm=larger.size_mm + _LARGER_MM - _BLOCK_MM))
        both = block, closing(block_mm=_LARGER_MM)
        block = BlockPairs(
            **{f.name: tuple(chain(*(getattr(b, f.name) for b in both))) for f in fields(block)}
        )
    return Calibration(
        sensor_id=sensor_id,
        origin="simulated",
        layout=world.layout,
        rest=rest,
        force=force,
        block=block,
        current=current,
        force_law=fit_sheet_law(force, layout=world.layout).as_dict(),
    )


def _calibrate_current(bench: Bench, world: Workplace) -> CurrentPairs | None:
    """Measure the current on the block with the load cell, then with the gripper empty."""
    on_block = measure_current(bench, up_to_n=_BLOCK_N, repeats=_BLOCK_REPEATS)
    world.place(None)
    empty = measure_gear_friction(bench)
    return None if on_block is None or empty is None else join_currents(on_block, empty)


def read_through_firmware(world: World) -> PressureArray:
    """Return the array of a world, read by the firmware on the AVR simulator.

    Raises `DeviceNotFoundError` if the firmware or the simulator has not been built.
    """
    divider = world.layout.divider
    count_mv = 1e3 * divider.supply_v / divider.full_scale
    return open_firmware_array(
        world,
        noise_mv=count_mv * ranges_of(world.level).adc_noise_counts,
        rate_hz=world.frame_rate_hz,
    )


def open_twin_bench(rig: str, seed: int) -> GuidedBench:
    """Open the bench of a simulated rig.

    Raises `DeviceError` for any other rig than `sim-rigid`.
    """
    if rig != "sim-rigid":
        raise DeviceError(
            f"rig {rig!r} has no load cell that palpate can read (a rig file describes load cells "
            "in [load_cells]). Force alone can be calibrated with dead weights (`palpate "
            "calibrate force --loads`); --rig sim-rigid demonstrates every step"
        )
    rng = np.random.default_rng([seed, 12])
    world = World(None, seed=seed + 2_000_003, sheet_seed=seed)
    return GuidedBench(
        bench=twin_bench(world, start=_START_POSITION["rigid"]),
        reseat=lambda run: world.place(draw_object(rng, FACES[run % len(FACES)])),
        place_block=lambda: world.place(draw_object(rng, "rigid-block")),
        remove_object=lambda: world.place(None),
        is_simulated=True,
    )


def twin_bench(world: Stage, *, start: float) -> Bench:
    """Return a bench with the devices of a world.

    `start`: as in `Bench`.

    >>> twin_bench(World(None, seed=1), start=51.0).cell.read_n() < 0.1
    True
    """
    array = TwinArray(world)
    return Bench(
        array=array,
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start=start,
        # Unread frames need not be computed.
        skip_until=array.skip_until,
    )
