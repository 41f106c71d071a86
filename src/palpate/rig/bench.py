"""The calibration bench of a real rig, with an open gripper and tared load cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.calibrate.guided import Bench, wait_for_rest
from palpate.calibrate.sheet_cell import SheetCell
from palpate.calibration import Calibration
from palpate.clock import Clock, RealClock
from palpate.errors import InputError
from palpate.gripper.interface import Gripper, open_fully
from palpate.rig.board_cell import BoardLoadCell, require_board
from palpate.rig.file import check_layout, open_devices, read_rig_file
from palpate.sensor.array import PressureArray

#: Distance from the block at which the slow search for its touch begins, and its speed: a sheet
#: read 15 times a second then sees the touch within a tenth of a millimetre.
_BLOCK_CLEARANCE_MM, _SHEET_APPROACH_MM_PER_S = 2.0, 1.0
_REST_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedBench:
    """A bench with a load cell, and the manual actions of its user."""

    #: The devices.
    bench: Bench
    #: Places the load cell with the face for a run between the fingers.
    reseat: Callable[[int], None]
    #: Places the rigid block between the fingers.
    place_block: Callable[[], None]
    #: Removes the object between the fingers.
    remove_object: Callable[[], None]
    #: Whether the bench is simulated.
    is_simulated: bool


@contextmanager
def open_board_bench(path: Path) -> Iterator[tuple[Bench, BoardLoadCell]]:
    """Open the bench of a rig file with `[load_cells]`; open the gripper at the end.

    Yields the bench and its load cell, which must be tared again after each new placement. The
    calibration file of the rig may not exist yet.

    Raises `InputError` if the rig file is invalid, has no load cells, or has fingers driven by
    pressure; `DeviceError` if equipment is missing, or a load cell is faulty.
    """
    rig_file = read_rig_file(path)
    if rig_file.newtons_per_count is None:
        raise InputError(
            f"rig file {path}: no table [load_cells]; `palpate calibrate cell` measures its values"
        )
    with ExitStack() as stack:
        array, gripper = open_devices(rig_file)
        stack.callback(gripper.close)
        stack.callback(array.close)
        yield stack.enter_context(
            open_bench(
                array,
                gripper=gripper,
                clock=RealClock(),
                newtons_per_count=rig_file.newtons_per_count,
            )
        )


@contextmanager
def open_sheet_bench(path: Path, *, calibration: Calibration, block_mm: float) -> Iterator[Bench]:
    """Open the bench of a rig file whose sheet, once calibrated, takes the place of a load cell.

    The gripper is open at the start and at the end; the rest of the sheet is measured anew.

    Raises `InputError` if the rig file is invalid or has no gripper; `CalibrationError` if the
    calibration has no force law or is of another sensor; `DeviceError` if equipment is missing.
    """
    rig_file, clock = read_rig_file(path), RealClock()
    if rig_file.gripper is None:
        raise InputError(f"rig file {path}: no table [gripper], whose compliance could be measured")
    with ExitStack() as stack:
        array, gripper = open_devices(rig_file)
        stack.callback(gripper.close)
        stack.callback(array.close)
        check_layout(calibration, array, file=rig_file.calibration, rig_file=path)
        open_fully(gripper, clock=clock)
        stack.callback(open_fully, gripper, clock=clock)
        yield make_sheet_bench(
            array, gripper=gripper, clock=clock, calibration=calibration, block_mm=block_mm
        )


def make_sheet_bench(
    array: PressureArray,
    *,
    gripper: Gripper,
    clock: Clock,
    calibration: Calibration,
    block_mm: float,
) -> Bench:
    """Return a bench that reads the force by the sheet; `gripper`: open, with nothing between.

    Raises `DeviceError` if the sensor does not come to rest.
    """
    cell = SheetCell(array, clock=clock, calibration=calibration)
    start, approach = gripper.limits.target(0.0), None
    if gripper.limits.drive == "width":
        start = min(start, block_mm + _BLOCK_CLEARANCE_MM)
        approach = _SHEET_APPROACH_MM_PER_S
    bench = Bench(
        array=cell,
        gripper=gripper,
        cell=cell,
        clock=clock,
        start=start,
        approach=approach,
        high_n=lambda: cell.high_n,
    )
    cell.rest_ohm = wait_for_rest(bench, duration_s=_REST_S).rest_ohm
    return replace(bench, touch_n=max(bench.touch_n, cell.measure_noise_n(_REST_S)))


@contextmanager
def open_bench(
    array: PressureArray, *, gripper: Gripper, clock: Clock, newtons_per_count: tuple[float, ...]
) -> Iterator[tuple[Bench, BoardLoadCell]]:
    """Open the gripper and tare the load cells; open the gripper at the end.

    The object's size is unknown, so slow closing starts from the fully open gripper.

    Raises `InputError` if the fingers are driven by pressure, or the array is not a board with
    palpate's firmware; `DeviceError` if a load cell is faulty.
    """
    if gripper.limits.drive == "pressure":
        raise InputError(
            "the guided steps need width-driven fingers, but this gripper is driven by pressure; "
            "calibrate its force with dead weights (`palpate calibrate force --loads CSV`)"
        )
    board = require_board(array)
    cell = BoardLoadCell(board, clock=clock, newtons_per_count=newtons_per_count)
    open_fully(gripper, clock=clock)
    cell.tare()
    bench = Bench(
        array=array, gripper=gripper, cell=cell, clock=clock, start=gripper.limits.target(0.0)
    )
    try:
        yield bench, cell
    finally:
        open_fully(gripper, clock=clock)
