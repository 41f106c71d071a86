"""Calibration of the servo's current, from slow closings on a load cell and without load."""

from __future__ import annotations

import math

from palpate.calibrate.guided import Bench
from palpate.errors import CalibrationError
from palpate.gripper.interface import GripperCommand
from palpate.sensor.calibration import CurrentPairs

#: Slow enough (mm/s or kPa/s) that the cell's reading and the current belong to one moment.
_RATE, _POLL_S = 1.5, 0.05
#: The empty hand closes faster: only the friction of the gears changes on its way.
_EMPTY_RATE = 3.0
#: Short movements of the empty hand, as a grasp makes them: length (mm or kPa) and duration.
_STEP, _STEP_S = 1.5, 0.38
#: An empty hand whose load cell reads more than this is not empty, newtons.
_EMPTY_N = 0.5

#: Force, current and width of single readings.
_Rows = list[tuple[float, float, float, int]]


def measure_current(bench: Bench, *, up_to_n: float, repeats: int) -> CurrentPairs | None:
    """Close slowly on the load cell and pair its force with the servo's current.

    Returns None where the gripper reports no current. Readings before contact are kept: they show
    what the gears take without load.
    """
    limits = bench.gripper.limits
    rows = _Rows()
    for movement in range(repeats):
        _move(bench, GripperCommand(target=bench.start, rate=limits.fastest))
        bench.gripper.command(GripperCommand(target=limits.target(limits.span), rate=_RATE))
        _record_movement(bench, rows, movement=movement, up_to_n=up_to_n)
        bench.gripper.stop()
    _release(bench)
    return _pairs(rows)


def measure_gears(bench: Bench, *, sweeps: int = 3) -> CurrentPairs | None:
    """Close the empty hand slowly, then in short steps, and read the current.

    The slow closings show where on the way the gears take more; the steps, how much that differs
    from one movement to the next. Returns None where the gripper reports no current.

    Raises `CalibrationError` if the load cell shows a force, as the hand isn't empty.
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
    _release(bench)
    if any(force > _EMPTY_N for force, *_ in rows):
        raise CalibrationError(
            "current calibration: the hand must close empty here, and the load cell measures "
            f"{max(rows)[0]:.1f} N; take the cell out from between the fingers"
        )
    return _pairs(rows)


def _record_movement(bench: Bench, rows: _Rows, *, movement: int, up_to_n: float) -> None:
    """Read force, current and width until the movement ends, or the force is reached."""
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


def _release(bench: Bench) -> None:
    bench.gripper.release()
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)


def _move(bench: Bench, command: GripperCommand) -> None:
    bench.gripper.command(command)
    bench.clock.sleep_s(_POLL_S)
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)
