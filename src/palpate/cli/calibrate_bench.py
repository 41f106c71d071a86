"""The bench of a calibration, and the file that its steps go into."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import typer

from palpate.errors import CalibrationError
from palpate.files import check_writable
from palpate.rig.bench import open_board_bench
from palpate.rig.file import find_calibration_file, read_load_cells
from palpate.rig.simulated import GuidedBench, open_twin_bench
from palpate.sensor.array import ArrayLayout
from palpate.sensor.calibration import Calibration

#: Where neither option nor rig file names another.
DEFAULT_FILE = Path("calibration.json")


def ask_user(what: str) -> None:
    """Show an instruction, and wait for Enter."""
    typer.prompt(what, default="", err=True, show_default=False)


def has_load_cell(rig: str) -> bool:
    """Return whether a rig, by name or file, has a readable load cell.

    Raises `InputError` if a rig file can't be read, or its description of the load cells is wrong.
    """
    return rig == "sim-rigid" or (rig.endswith(".toml") and read_load_cells(Path(rig)) is not None)


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

        def ask_and_tare(what: str) -> None:
            ask_user(f"{what}, then Enter")
            cell.tare()

        def ask_to_place(what: str) -> None:
            ask_and_tare(f"{what} between the open fingers, touching neither")

        yield GuidedBench(
            bench=bench,
            reseat=lambda _: ask_to_place(
                f"placement {next(number)} of {placements}: the load cell, with another face"
            ),
            place_block=lambda: ask_to_place("the rigid block with the load cell"),
            remove_object=lambda: ask_and_tare("take the block out: nothing between the fingers"),
            simulated=False,
        )


def calibration_file(rig: str, out: Path | None) -> Path:
    """Return the output file of a step: the option's, the rig file's or the default.

    Raises `InputError` if the rig file can't be read, or the calibration could not be written in
    the end.
    """
    named = find_calibration_file(Path(rig)) if out is None and rig.endswith(".toml") else None
    path = out or named or DEFAULT_FILE
    check_writable(path)
    return path


def earlier_calibration(path: Path, *, layout: ArrayLayout, simulated: bool) -> Calibration | None:
    """Return the existing calibration of a file to be updated; None without one.

    Raises `CalibrationError` if the file is of another sensor, or can't be read.
    """
    if not path.exists():
        return None
    earlier = Calibration.load(path)
    origin = "simulated" if simulated else "hardware"
    if difference := earlier.layout.describe_difference(layout):
        raise CalibrationError(
            f"{path} is of another sensor ({difference}); fix the rig file, "
            "give another --out, or start the file again with `palpate calibrate rest --new`"
        )
    if earlier.origin != origin:
        raise CalibrationError(
            f"{path} is of origin {earlier.origin}, this sensor is {origin}; give another --out"
        )
    return earlier
