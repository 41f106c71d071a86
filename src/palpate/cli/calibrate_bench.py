"""The bench and the files of a calibration."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import typer

from palpate.calibration import Calibration
from palpate.errors import CalibrationError
from palpate.files import check_writable
from palpate.rig.bench import GuidedBench, open_board_bench, open_sheet_bench
from palpate.rig.file import find_calibration_file, read_load_cells
from palpate.sensor.array import ArrayLayout
from palpate.twin.rig import open_twin_bench

#: Output file if neither an option nor the rig file names one.
DEFAULT_FILE = Path("calibration.json")


def prompt_user(instruction: str) -> None:
    """Show an instruction, and wait for Enter."""
    typer.prompt(instruction, default="", err=True, show_default=False)


def has_load_cell(rig: str) -> bool:
    """Return whether a named rig or a rig file has a readable load cell.

    Raises `InputError` if a rig file can't be read or its `[load_cells]` table is invalid.
    """
    return rig == "sim-rigid" or (rig.endswith(".toml") and read_load_cells(Path(rig)) is not None)


@contextmanager
def open_bench(rig: str, *, seed: int, placements: int = 1) -> Iterator[GuidedBench]:
    """Open the bench of a rig: the twin, or a board with a gripper.

    `rig`: name of a rig, or a rig file with `[load_cells]`.
    `placements`: total number of load-cell placements in all steps.
    Raises `InputError` if the rig file is invalid or the fingers are driven by pressure;
    `DeviceError` if the rig has no load cell, equipment is missing, or a load cell reading is
    unreliable.
    """
    if not (rig.endswith(".toml") and has_load_cell(rig)):
        yield open_twin_bench(rig, seed)
        return

    # Each step numbers its runs from 0; the prompts number the placements of all steps.
    number = count(1)
    with open_board_bench(Path(rig)) as (bench, cell):

        def prompt_and_tare(instruction: str) -> None:
            prompt_user(f"{instruction}, then press Enter")
            cell.tare()

        def prompt_to_place(item: str, *, step: str = "") -> None:
            prompt_and_tare(f"{step}place {item} between the open fingers, without contact")

        yield GuidedBench(
            bench=bench,
            reseat=lambda _: prompt_to_place(
                "the load cell on another face", step=f"placement {next(number)} of {placements}: "
            ),
            place_block=lambda: prompt_to_place("the rigid block with the load cell"),
            remove_object=lambda: prompt_and_tare("remove the block: nothing between the fingers"),
            is_simulated=False,
        )


@contextmanager
def open_block_bench(
    rig: str, *, seed: int, block_mm: float, known: Calibration | None
) -> Iterator[GuidedBench]:
    """Open the bench of a rig to close on a block: with its load cell, or else with its sheet.

    `block_mm`: thickness of the block.
    `known`: the calibration so far, whose force law the sheet needs.
    Raises errors as `open_bench`, and `CalibrationError` as `open_sheet_bench`.
    """
    if not rig.endswith(".toml") or known is None or has_load_cell(rig):
        with open_bench(rig, seed=seed) as guided:
            yield guided
        return
    with open_sheet_bench(Path(rig), calibration=known, block_mm=block_mm) as bench:
        yield GuidedBench(
            bench=bench,
            reseat=lambda _: None,
            place_block=lambda: prompt_user(
                "place the rigid block between the open fingers, without contact, then press Enter"
            ),
            remove_object=lambda: prompt_user("remove the block, then press Enter"),
            is_simulated=False,
        )


def resolve_calibration_file(rig: str, out: Path | None) -> Path:
    """Return a step's output file: from the option, the rig file or the default.

    Raises `InputError` if the rig file can't be read or the output file is not writable.
    """
    named = find_calibration_file(Path(rig)) if out is None and rig.endswith(".toml") else None
    path = out or named or DEFAULT_FILE
    check_writable(path)
    return path


def load_earlier_calibration(
    path: Path, *, layout: ArrayLayout, simulated: bool
) -> Calibration | None:
    """Load the calibration to be updated; None if the file does not exist.

    Raises `CalibrationError` if the file can't be read or belongs to another sensor.
    """
    if not path.exists():
        return None
    earlier = Calibration.load(path)
    origin = "simulated" if simulated else "hardware"
    if difference := earlier.layout.describe_difference(layout):
        raise CalibrationError(
            f"{path} belongs to another sensor ({difference}); fix the rig file, "
            "give another --out, or start the file again with `palpate calibrate rest --new`"
        )
    if earlier.origin != origin:
        raise CalibrationError(
            f"{path} has origin {earlier.origin}, but this sensor has origin {origin}; "
            "give another --out"
        )
    return earlier
