"""A real rig as bench of a calibration: open gripper, load cells at zero."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from palpate.calibrate.guided import Bench
from palpate.clock import Clock, RealClock
from palpate.errors import InputError
from palpate.gripper.interface import Gripper
from palpate.rig.board_cell import BoardLoadCell, board_with_cells
from palpate.rig.file import open_devices, read_rig_file
from palpate.sensor.array import PressureArray

_POLL_S = 0.05


@contextmanager
def open_board_bench(path: Path) -> Iterator[tuple[Bench, BoardLoadCell]]:
    """Open the bench of a rig file with `[load_cells]`; open the gripper at the end.

    Yields the bench, and its load cell, to be set to zero again where it is placed again.

    The calibration that the file names need not be there yet.

    Raises `InputError` if the rig file is at fault, has no load cells, or fingers driven by
    pressure; `DeviceError` if equipment is missing, or a load cell does not read as it should.
    """
    rig_file = read_rig_file(path)
    if rig_file.newtons_per_count is None:
        raise InputError(f"rig file {path}: has no table [load_cells]")
    with ExitStack() as stack:
        array, gripper = open_devices(rig_file)
        stack.callback(gripper.close)
        stack.callback(array.close)
        yield stack.enter_context(
            bench_of(
                array,
                gripper=gripper,
                clock=RealClock(),
                newtons_per_count=rig_file.newtons_per_count,
            )
        )


@contextmanager
def bench_of(
    array: PressureArray, *, gripper: Gripper, clock: Clock, newtons_per_count: tuple[float, ...]
) -> Iterator[tuple[Bench, BoardLoadCell]]:
    """Open the gripper and set the load cells to zero; open it at the end.

    The object's size is unknown, so the slow closing begins at the open hand.

    Raises `InputError` if the fingers are driven by pressure, or the array is no board with
    palpate's firmware; `DeviceError` if a load cell does not read as it should.
    """
    if gripper.limits.drive == "pressure":
        raise InputError(
            "the guided steps move fingers by millimetres, and these are driven by pressure; "
            "calibrate their force with dead weights (`palpate calibrate force --loads CSV`)"
        )
    board = board_with_cells(array)
    cell = BoardLoadCell(board, clock=clock, newtons_per_count=newtons_per_count)
    _open(gripper, clock=clock)
    cell.tare()
    bench = Bench(
        array=array, gripper=gripper, cell=cell, clock=clock, start=gripper.limits.target(0.0)
    )
    try:
        yield bench, cell
    finally:
        _open(gripper, clock=clock)


def _open(gripper: Gripper, *, clock: Clock) -> None:
    gripper.release()
    while gripper.state().moving:
        clock.sleep_s(_POLL_S)
