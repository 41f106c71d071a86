"""Calibration of the servo's current: slow closings on a block that carries the load cell."""

from __future__ import annotations

import math

from palpate.grasp.calibrating import Bench
from palpate.gripper.interface import GripperCommand
from palpate.sensor.current_pairs import CurrentPairs

#: So slowly (mm or kPa a second) that the cell's reading and the current are of one moment.
_RATE, _POLL_S = 1.5, 0.05


def measure_current(bench: Bench, *, up_to_n: float, repeats: int) -> CurrentPairs | None:
    """Close slowly on the load cell and pair its force with the servo's current.

    Returns None where the gripper reports no current. Readings before contact are kept: they tell
    what the gears take without load.
    """
    limits = bench.gripper.limits
    force_n, current_ma = list[float](), list[float]()
    for _ in range(repeats):
        _go(bench, GripperCommand(target=bench.start, rate=limits.fastest))
        bench.gripper.command(GripperCommand(target=limits.target(limits.span), rate=_RATE))
        while True:
            bench.clock.sleep_s(_POLL_S)
            state, force = bench.gripper.state(), bench.cell.read_n()
            if not state.moving or force >= up_to_n:
                break
            if math.isfinite(state.current_ma):
                force_n.append(force)
                current_ma.append(state.current_ma)
        bench.gripper.stop()
    bench.gripper.release()
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)
    return CurrentPairs(force_n=tuple(force_n), current_ma=tuple(current_ma)) if force_n else None


def _go(bench: Bench, command: GripperCommand) -> None:
    bench.gripper.command(command)
    bench.clock.sleep_s(_POLL_S)
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)
