"""Calibration by the steps that a user makes: rest, closing on a load cell, closing on a block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.clock import Clock
from palpate.errors import CalibrationError
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.sensor.array import PressureArray
from palpate.sensor.calibration import BlockPairs, ForcePairs, RestValues
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import (
    RestBaseline,
    excess_conductance,
    mean_change,
    relative_change_percent,
    rest_baseline,
    total_excess,
)

FloatArray = NDArray[np.float64]

#: A first touch of the load cell, newtons. Closing goes on slowly up to it, then in steps that grow
#: with the force, so that small forces get as many readings as large ones.
_TOUCH_N = 0.05
_APPROACH_MM_PER_S, _POLL_S, _RATE_MM_PER_S = 6.0, 0.02, 20.0
_STEP_MM_PER_N, _FINEST_MM, _COARSEST_MM = 0.1, 0.1, 0.5
#: Readings are means over this time: of the last frames of a dwell, and of a settled hold.
_EARLY_MEAN_S, _SETTLED_MEAN_S = 0.2, 0.5
_FRAME_TIMEOUT_S = 2.0
#: The sheet may take this long to forget a load before its rest is refused.
_RECOVERY_S = 120.0


class LoadCell(Protocol):
    """A reference force in the place of the object."""

    def read_n(self) -> float:
        """Return the grip force now, newtons."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """The devices of a calibration, and the opening from which to close slowly.

    Attributes
    ----------
    array, gripper, cell, clock
        The devices.
    start_mm : float
        A little more than the largest thing that will be between the fingers.
    """

    array: PressureArray
    gripper: Gripper
    cell: LoadCell
    clock: Clock
    start_mm: float


def measure_rest(bench: Bench, *, duration_s: float = 2.0) -> RestValues:
    """Open the hand and take the rest values.

    Raises
    ------
    CalibrationError
        If the sensor is loaded or moving.
    """
    _open(bench)
    rest = _rest(bench, duration_s=duration_s)
    return RestValues(
        ohm=tuple(map(tuple, rest.rest_ohm.tolist())),
        spread_percent=tuple(map(tuple, rest.spread_percent.tolist())),
        frames=rest.frames,
    )


def measure_force(
    bench: Bench,
    *,
    holds_n: Sequence[Sequence[float]],
    reseat: Callable[[int], None],
    dwell_s: float,
    horizon_s: float = 20.0,
) -> ForcePairs:
    """Close on a load cell in steps and pair its force with what the sheet reads.

    Each run is a fresh placement of the cell. A run closes step by step, as a grasp does, reading
    every step after `dwell_s`; at each force of its list it stands still until `horizon_s` and
    reads the settled value.

    Parameters
    ----------
    bench : Bench
        The devices.
    holds_n : sequence of sequences of float
        For each run, rising forces at which to hold.
    reseat : callable
        Called with the number of the run once the hand is open: the user moves the load cell.
    dwell_s : float
        Wait after each step before it is read.
    horizon_s : float
        When the sheet counts as settled.

    Raises
    ------
    CalibrationError
        If the load cell never feels the hand.
    """
    rows: list[tuple[int, float, float, float, float]] = []
    for run, levels in enumerate(holds_n):
        _open(bench)
        reseat(run)
        rest = _rest(bench, duration_s=1.0)
        for level_n in levels:
            moved_s = bench.clock.now_s()
            while bench.cell.read_n() < level_n:
                moved_s = bench.clock.now_s()
                if not _close_once(bench):
                    break
                reading = _reading(bench, rest, moved_s + dwell_s, mean_s=_EARLY_MEAN_S)
                if reading[2] > _TOUCH_N:
                    rows.append((run, dwell_s, *reading))
            settled = _reading(bench, rest, moved_s + horizon_s, mean_s=_SETTLED_MEAN_S)
            rows.append((run, horizon_s, *settled))
    _open(bench)
    if not any(row[4] > _TOUCH_N for row in rows):
        raise CalibrationError(
            "force calibration: the hand closed fully and the load cell felt nothing; "
            "is the cell between the fingers, and connected?"
        )
    columns = list(zip(*rows, strict=True))
    return ForcePairs(
        run=columns[0],
        since_move_s=columns[1],
        excess=columns[2],
        relative_percent=columns[3],
        force_n=columns[4],
    )


def measure_block(
    bench: Bench, *, block_mm: float, up_to_n: float, repeats: int, dwell_s: float
) -> BlockPairs:
    """Close on a rigid block of known size that carries the load cell, and note the widths."""
    width_mm: list[float] = []
    force_n: list[float] = []
    for _ in range(repeats):
        _open(bench)
        while bench.cell.read_n() < up_to_n and _close_once(bench):
            _wait(bench, bench.clock.now_s() + dwell_s)
            force = bench.cell.read_n()
            if force > _TOUCH_N:
                width_mm.append(bench.gripper.state().width_mm)
                force_n.append(force)
    _open(bench)
    return BlockPairs(
        block_mm=(block_mm,) * len(width_mm), width_mm=tuple(width_mm), force_n=tuple(force_n)
    )


def _open(bench: Bench) -> None:
    bench.gripper.release()
    while bench.gripper.state().moving:
        bench.clock.sleep_s(0.05)
    # The opening's own spike and the sheet's memory of the last load have to fade.
    _wait(bench, bench.clock.now_s() + 3.0)


def _close_once(bench: Bench) -> bool:
    """Take one step; return whether there was room for it."""
    force_n, lowest_mm = bench.cell.read_n(), bench.gripper.limits.lowest
    width_mm = bench.gripper.state().width_mm
    if width_mm <= lowest_mm:
        return False
    if force_n < _TOUCH_N:
        if width_mm > bench.start_mm:
            _drive(bench, bench.start_mm)
        bench.gripper.command(GripperCommand(target=lowest_mm, rate=_APPROACH_MM_PER_S))
        while bench.gripper.state().moving and bench.cell.read_n() < _TOUCH_N:
            bench.clock.sleep_s(_POLL_S)
        bench.gripper.stop()
        return True
    step_mm = min(max(_STEP_MM_PER_N * force_n, _FINEST_MM), _COARSEST_MM)
    _drive(bench, width_mm - step_mm)
    return True


def _drive(bench: Bench, width_mm: float) -> None:
    bench.gripper.command(GripperCommand(target=width_mm, rate=_RATE_MM_PER_S))
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)


def _wait(bench: Bench, until_s: float) -> None:
    """Read and drop frames until a time, so that the next one is fresh."""
    while bench.array.read(timeout_s=_FRAME_TIMEOUT_S).time_s < until_s:
        pass


def _rest(bench: Bench, *, duration_s: float) -> RestBaseline:
    """Take rest values, giving the sheet time to forget the last load."""
    give_up_s = bench.clock.now_s() + _RECOVERY_S
    while True:
        ohm = _ohm(bench, bench.clock.now_s() + duration_s, mean_s=duration_s)
        try:
            return rest_baseline(ohm)
        except CalibrationError:
            if bench.clock.now_s() > give_up_s:
                raise
            _wait(bench, bench.clock.now_s() + 5.0)


def _reading(
    bench: Bench, rest: RestBaseline, until_s: float, *, mean_s: float
) -> tuple[float, float, float]:
    """Return excess, relative change and the cell's force, means of the last `mean_s`."""
    ohm = _ohm(bench, until_s, mean_s=mean_s)
    excess = total_excess(excess_conductance(ohm, rest_ohm=rest.rest_ohm))
    relative = mean_change(relative_change_percent(ohm, rest_ohm=rest.rest_ohm))
    return float(np.mean(excess)), float(np.mean(relative)), bench.cell.read_n()


def _ohm(bench: Bench, until_s: float, *, mean_s: float) -> FloatArray:
    """Return the resistances of the frames in the last `mean_s` before a time."""
    divider, found = bench.array.layout.divider, list[FloatArray]()
    while True:
        frame = bench.array.read(timeout_s=_FRAME_TIMEOUT_S)
        if frame.time_s > until_s - mean_s:
            found.append(
                resistance_ohm(frame.counts, divider=divider, oversampling=frame.oversampling)
            )
        if frame.time_s >= until_s:
            return np.array(found)
