"""Calibration of the servo current: slow closings on a load cell and without load."""

from __future__ import annotations

import math

from palpate.calibrate.guided import Bench
from palpate.calibration import CurrentPairs
from palpate.errors import CalibrationError
from palpate.gripper.interface import GripperCommand, open_fully

#: Closing rate (mm/s or kPa/s), slow enough to pair the cell's reading with the current.
_RATE, _POLL_S = 1.5, 0.05
#: Closing rate of the empty gripper: faster, as only the gear friction changes along the travel.
_EMPTY_RATE = 3.0
#: Short movements of the empty gripper, as in a grasp: length (mm or kPa) and duration.
_STEP, _STEP_S = 1.5, 0.38
#: Maximum load cell reading of an empty gripper, newtons.
_EMPTY_N = 0.5

#: Force, current, width and movement number of each reading.
_Rows = list[tuple[float, float, float, int]]


def measure_current(bench: Bench, *, up_to_n: float, repeats: int) -> CurrentPairs | None:
    """Close slowly on the load cell and pair its force with the servo current.

    Returns None if the gripper reports no current. The readings before contact are included,
    because they contain the gear friction without load.
    """
    limits = bench.gripper.limits
    rows = _Rows()
    for movement in range(repeats):
        _move(bench, GripperCommand(target=bench.start, rate=limits.fastest))
        bench.gripper.command(GripperCommand(target=limits.target(limits.span), rate=_RATE))
        _record_movement(bench, rows, movement=movement, up_to_n=up_to_n)
        bench.gripper.stop()
    open_fully(bench.gripper, clock=bench.clock)
    return _pairs(rows)


def measure_gear_friction(bench: Bench, *, sweeps: int = 3) -> CurrentPairs | None:
    """Close the empty gripper slowly, then in short steps, and read the current.

    The slow closings show the variation of the gear friction along the travel; the steps show its
    variation between movements. Returns None if the gripper reports no current.

    Raises `CalibrationError` if the load cell measures a force, because the gripper isn't empty.
    """
    limits = bench.gripper.limits
    rows = _Rows()
    for movement in range(sweeps):
        _move(bench, GripperCommand(target=limits.target(0.0), rate=limits.fastest))
        bench.gripper.command(GripperCommand(target=limits.target(limits.span), rate=_EMPTY_RATE))
        _record_movement(bench, rows, movement=movement, up_to_n=math.inf)
    _move(bench, GripperCommand(target=limits.target(0.0), rate=limits.fastest))
    for step in range(1, int(limits.span / _STEP)):
        target = limits.target(step * _STEP)
        bench.gripper.command(GripperCommand(target=target, rate=_STEP / _STEP_S))
        _record_movement(bench, rows, movement=sweeps + step, up_to_n=math.inf)
    open_fully(bench.gripper, clock=bench.clock)
    if any(force > _EMPTY_N for force, *_ in rows):
        raise CalibrationError(
            "current calibration: the gripper must close empty, but the load cell measures "
            f"{max(rows)[0]:.1f} N; remove the cell from between the fingers"
        )
    return _pairs(rows)


def _record_movement(bench: Bench, rows: _Rows, *, movement: int, up_to_n: float) -> None:
    """Read force, current and width until the movement ends or the force is reached."""
    while True:
        bench.clock.sleep_s(_POLL_S)
        state, force = bench.gripper.state(), bench.cell.read_n()
        if not state.moving or force >= up_to_n:
            return
        if math.isfinite(state.current_ma):
            rows.append((force, state.current_ma, state.width_mm, movement))


def _pairs(rows: _Rows) -> CurrentPairs | None:
    if not rows:
        return None
    force_n, current_ma, width_mm, movement = zip(*rows, strict=True)
    return CurrentPairs(
        force_n=force_n, current_ma=current_ma, width_mm=width_mm, movement=movement
    )


def _move(bench: Bench, command: GripperCommand) -> None:
    bench.gripper.command(command)
    bench.clock.sleep_s(_POLL_S)
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)
