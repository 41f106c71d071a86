"""The bench of a calibration, and the file that its steps go into."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

import numpy as np
import typer

from palpate.errors import CalibrationError, DeviceError
from palpate.files import check_place
from palpate.grasp.calibrating import Bench
from palpate.rig.bench import open_board_bench
from palpate.rig.file import load_cells_stated, read_stated
from palpate.rig.simulated import FACES, twin_bench
from palpate.sensor.array import ArrayLayout
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.twin.objects import draw_object
from palpate.twin.world import World

#: Where neither option nor rig file names another.
DEFAULT_FILE = Path("calibration.json")
#: No face of the load cell is larger.
_START_MM = 51.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedBench:
    """A bench with a load cell, and the hands of its user."""

    #: The devices.
    bench: Bench
    #: Puts the load cell with the face of a run between the fingers.
    reseat: Callable[[int], None]
    #: Puts the rigid block there.
    place_block: Callable[[], None]
    #: Takes away what lies between the fingers.
    take_away: Callable[[], None]
    #: Whether all that is the twin.
    simulated: bool


def ask_user(what: str) -> None:
    """Show an instruction, and wait for Enter."""
    typer.prompt(what, default="", err=True, show_default=False)


def has_load_cell(rig: str) -> bool:
    """Return whether a rig, by name or file, has a load cell that palpate can read.

    Raises `InputError` if a rig file can't be read, or its description of the load cells is wrong.
    """
    return rig == "sim-rigid" or (
        rig.endswith(".toml") and load_cells_stated(Path(rig)) is not None
    )


@contextmanager
def open_bench(rig: str, *, seed: int, placements: int = 1) -> Iterator[GuidedBench]:
    """Open the bench of a rig: the twin's, or a board's with a gripper.

    `rig`: name of a rig, or a rig file with `[load_cells]`.
    `placements`: how often the load cell will be placed, all steps together.
    Raises `InputError` if the rig file is at fault, or its fingers are driven by pressure;
    `DeviceError` if the rig has no load cell, equipment is missing, or a load cell does not read
    well.
    """
    if not (rig.endswith(".toml") and has_load_cell(rig)):
        yield open_twin_bench(rig, seed)
        return

    # Steps count their own runs from 0; the person who places the cell sees one running count.
    number = count(1)
    with open_board_bench(Path(rig)) as (bench, cell):

        def tared(what: str) -> None:
            ask_user(f"{what}, then Enter")
            cell.tare()

        def placed(what: str) -> None:
            tared(f"{what} between the open fingers, touching neither")

        yield GuidedBench(
            bench=bench,
            reseat=lambda _: placed(
                f"placement {next(number)} of {placements}: the load cell, with another face"
            ),
            place_block=lambda: placed("the rigid block with the load cell"),
            take_away=lambda: tared("take the block out: nothing between the fingers"),
            simulated=False,
        )


def open_twin_bench(rig: str, seed: int) -> GuidedBench:
    """Open the bench of a simulated rig.

    Raises `DeviceError` if the rig isn't one of the simulated ones with rigid fingers.
    """
    if rig != "sim-rigid":
        raise DeviceError(
            f"rig {rig!r} has no load cell that palpate can read (a rig file names its own in "
            "[load_cells]). Force alone goes with dead weights (`palpate calibrate force "
            "--loads`); --rig sim-rigid shows every step"
        )
    rng = np.random.default_rng([seed, 12])
    world: World = World(None, seed=seed + 2_000_003, sheet_seed=seed)
    return GuidedBench(
        bench=twin_bench(world, start=_START_MM),
        reseat=lambda run: world.place(draw_object(rng, FACES[run % len(FACES)])),
        place_block=lambda: world.place(draw_object(rng, "rigid-block")),
        take_away=lambda: world.place(None),
        simulated=True,
    )


def calibration_file(rig: str, out: Path | None) -> Path:
    """Return the output file of a step: the given one, the rig file's or the default.

    Raises `InputError` if the rig file can't be read, or the calibration could not be written in
    the end.
    """
    stated = read_stated(Path(rig)) if out is None and rig.endswith(".toml") else {}
    named = Path(rig).parent / str(stated["calibration"]) if "calibration" in stated else None
    path = out or named or DEFAULT_FILE
    check_place(path)
    return path


def earlier_calibration(path: Path, *, layout: ArrayLayout, simulated: bool) -> Calibration | None:
    """Return the calibration in a file that is to be renewed; None without one.

    Raises `CalibrationError` if the file is of another sensor, or can't be read.
    """
    if not path.exists():
        return None
    earlier = Calibration.load(path)
    origin = "simulated" if simulated else "hardware"
    if difference := earlier.layout.difference(layout):
        raise CalibrationError(
            f"{path} is of another sensor ({difference}); fix the rig file, "
            "give another --out, or start the file again with `palpate calibrate rest --new`"
        )
    if earlier.origin != origin:
        raise CalibrationError(
            f"{path} is of origin {earlier.origin}, this sensor is {origin}; give another --out"
        )
    return earlier


def new_calibration(layout: ArrayLayout, *, rest: RestValues, simulated: bool) -> Calibration:
    """Return a calibration of rest values alone."""
    return Calibration(
        sensor_id=layout.name,
        origin="simulated" if simulated else "hardware",
        layout=layout,
        rest=rest,
        force=ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=()),
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
        made_at=now_text(),
    )


def now_text() -> str:
    """Return the date and time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")
