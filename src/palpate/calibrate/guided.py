"""Calibration by guided steps: rest, closing on a load cell, closing on a block."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate.arrays import FloatArray
from palpate.clock import Clock
from palpate.errors import CalibrationError, DeviceError
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.sensor.array import FRAME_TIMEOUT_S, PressureArray
from palpate.sensor.calibration import BlockPairs, ForcePairs, RestValues
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import (
    RestBaseline,
    excess_conductance,
    mean_change,
    relative_change_percent,
    rest_baseline,
)

#: Contact with the load cell, newtons. Closing is slow up to it, then in steps that grow
#: with the force, so that small forces get as many readings as large ones.
_TOUCH_N = 0.05
_POLL_S = 0.02
#: Readings are means over this time: of the last frames of a dwell, and of a settled hold.
_EARLY_MEAN_S, _SETTLED_MEAN_S = 0.2, 0.5
#: Settled holds of the guided steps, newtons, one list for each placement of the load cell: small
#: and large mixed.
HOLDS_N = ((0.4, 3.0), (0.8, 6.0), (0.3, 2.0), (1.5, 12.0), (0.6, 4.0), (2.5, 15.0))
#: Where frames are skipped, the last ones of a wait are read all the same.
_FRESH_S = 0.2
#: Pause with the hand open before a placement's rest is taken.
_FORGETTING_S = 30.0
#: The sheet may take this long to recover from a load before its rest is refused.
_RECOVERY_S = 120.0


class LoadCell(Protocol):
    """A reference force in the place of the object."""

    def read_n(self) -> float:
        """Return the grip force now, newtons."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pace:
    """Rates (mm/s, kPa/s) and steps (mm, kPa) of a closing on the load cell."""

    approach: float
    rate: float
    step_per_n: float
    finest: float
    coarsest: float


_PACES = {
    "width": _Pace(approach=6.0, rate=20.0, step_per_n=0.1, finest=0.1, coarsest=0.5),
    "pressure": _Pace(approach=4.0, rate=15.0, step_per_n=0.4, finest=0.3, coarsest=1.5),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetReading:
    """The sheet and the load cell read at one time; attributes as in `ForcePairs`."""

    since_move_s: float
    pixel_excess: tuple[float, ...]
    relative_percent: float
    force_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """The devices of a calibration, and where to begin to close slowly.

    `array`, `gripper`, `cell`, `clock`: the devices.
    `skip_until`: lets time pass without frames where none is needed; else they are read and
    dropped.
    `start`: width a little above, or pressure a little below, where the largest object that will be
    between the fingers is touched.
    """

    array: PressureArray
    gripper: Gripper
    cell: LoadCell
    clock: Clock
    start: float
    skip_until: Callable[[float], None] | None = None


def measure_rest(bench: Bench, *, duration_s: float = 2.0) -> RestValues:
    """Open the hand and take the rest values.

    Raises `CalibrationError` if the sensor is loaded or moving.
    """
    with _opening_after(bench):
        _open(bench)
        rest = _measure_rest(bench, duration_s=duration_s)
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
    """Close on a load cell in steps and pair its force with sheet readings.

    Each run is a fresh placement of the cell. A run closes step by step, as a grasp does, reading
    every step after `dwell_s`; at each force of its list it stands still until `horizon_s` and
    reads the settled value.

    `holds_n`: for each run, rising forces at which to hold.
    `reseat`: called with the number of the run once the hand is open: the user moves the load cell.
    `dwell_s`: wait after each step before it is read.
    `horizon_s`: when the sheet counts as settled.
    Raises `CalibrationError` if the load cell never shows a force.
    """
    rows: list[tuple[int, SheetReading]] = []
    with _opening_after(bench):
        for run, levels in enumerate(holds_n):
            _open(bench)
            reseat(run)
            rest = _measure_rest(bench, duration_s=1.0)
            for level_n in levels:
                found, room = _close_to_force(
                    bench, rest, level_n, dwell_s=dwell_s, horizon_s=horizon_s
                )
                rows += [(run, reading) for reading in found]
                if not room:
                    break
    if not any(reading.force_n > _TOUCH_N for _, reading in rows):
        raise CalibrationError(
            "force calibration: the hand closed fully and the load cell measured no force; "
            "is the cell between the fingers, and connected?"
        )
    readings = [reading for _, reading in rows]
    return ForcePairs(
        run=tuple(run for run, _ in rows),
        since_move_s=tuple(reading.since_move_s for reading in readings),
        excess=tuple(sum(reading.pixel_excess) for reading in readings),
        relative_percent=tuple(reading.relative_percent for reading in readings),
        force_n=tuple(reading.force_n for reading in readings),
        pixel_excess=tuple(reading.pixel_excess for reading in readings),
    )


def measure_block(
    bench: Bench, *, block_mm: float, up_to_n: float, repeats: int, dwell_s: float
) -> BlockPairs:
    """Close on a rigid block of known size with the load cell, and record it."""
    limits = bench.gripper.limits
    reported: list[float] = []
    force_n: list[float] = []
    with _opening_after(bench):
        for _ in range(repeats):
            _open(bench)
            while bench.cell.read_n() < up_to_n and _close_once(bench):
                _wait(bench, bench.clock.now_s() + dwell_s)
                force = bench.cell.read_n()
                if force > _TOUCH_N:
                    reported.append(limits.drive_reading(bench.gripper.state()))
                    force_n.append(force)
    by_width = limits.drive == "width"
    return BlockPairs(
        block_mm=(block_mm,) * len(reported),
        width_mm=tuple(reported) if by_width else (),
        force_n=tuple(force_n),
        pressure_kpa=() if by_width else tuple(reported),
    )


@contextmanager
def _opening_after(bench: Bench) -> Iterator[None]:
    """Open the hand at the end, after an error too: nothing stays pressed unattended."""
    try:
        yield
    finally:
        _release(bench)


def _release(bench: Bench) -> None:
    bench.gripper.release()
    while bench.gripper.state().moving:
        bench.clock.sleep_s(0.05)


def _close_to_force(
    bench: Bench, rest: RestBaseline, level_n: float, *, dwell_s: float, horizon_s: float
) -> tuple[list[SheetReading], bool]:
    """Close step by step to a force and settle; return the readings and the success."""
    readings: list[SheetReading] = []
    moved_s, room = bench.clock.now_s(), True
    while room and bench.cell.read_n() < level_n:
        looking = bench.cell.read_n() < _TOUCH_N
        moved_s = bench.clock.now_s()
        room = _close_once(bench)
        # A slow search for contact takes long; the sheet responds to its end.
        moved_s = bench.clock.now_s() if looking else moved_s
        if room:
            reading = _take_reading(
                bench, rest, moved_s, since_move_s=dwell_s, mean_s=_EARLY_MEAN_S
            )
            if reading.force_n > _TOUCH_N:
                readings.append(reading)
    settled = _take_reading(bench, rest, moved_s, since_move_s=horizon_s, mean_s=_SETTLED_MEAN_S)
    return [*readings, settled], room


def _open(bench: Bench) -> None:
    """Open just beyond the object between the fingers."""
    if bench.gripper.limits.closure(bench.gripper.state()) > _free_closure(bench):
        _move_to(bench, _free_closure(bench))
    # The opening's own spike and the sheet's memory of the last load have to fade: after 3 s a
    # rest may still have an error of 3 %, the residual of half a newton.
    _wait(bench, bench.clock.now_s() + _FORGETTING_S)


def _close_once(bench: Bench) -> bool:
    """Take one step; return whether there was room for it."""
    limits, force_n = bench.gripper.limits, bench.cell.read_n()
    pace, closure = _PACES[limits.drive], limits.closure(bench.gripper.state())
    if closure >= limits.span - 0.5 * pace.finest:
        return False
    if force_n < _TOUCH_N:
        if closure < _free_closure(bench):
            _move_to(bench, _free_closure(bench))
        bench.gripper.command(GripperCommand(target=limits.target(limits.span), rate=pace.approach))
        while bench.gripper.state().moving and bench.cell.read_n() < _TOUCH_N:
            bench.clock.sleep_s(_POLL_S)
        bench.gripper.stop()
        return True
    step = min(max(pace.step_per_n * force_n, pace.finest), pace.coarsest)
    _move_to(bench, closure + step)
    return True


def _free_closure(bench: Bench) -> float:
    """Return the largest closure without contact."""
    return abs(bench.start - bench.gripper.limits.target(0.0))


def _move_to(bench: Bench, closure: float) -> None:
    limits = bench.gripper.limits
    rate = _PACES[limits.drive].rate
    way = abs(closure - limits.closure(bench.gripper.state()))
    bench.gripper.command(GripperCommand(target=limits.target(closure), rate=rate))
    bench.clock.sleep_s(way / rate)
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)


def _wait(bench: Bench, until_s: float) -> None:
    """Read and drop frames until a time, so that the next one is fresh."""
    if bench.skip_until is not None:
        bench.skip_until(until_s - _FRESH_S)
    while bench.array.read(timeout_s=FRAME_TIMEOUT_S).time_s < until_s:
        pass


def _measure_rest(bench: Bench, *, duration_s: float) -> RestBaseline:
    """Measure rest values after the sheet has recovered from the last load."""
    give_up_s = bench.clock.now_s() + _RECOVERY_S
    while True:
        ohm = _ohm(bench, bench.clock.now_s() + duration_s, mean_s=duration_s)
        try:
            rest = rest_baseline(ohm)
        except CalibrationError as refused:
            if bench.clock.now_s() > give_up_s:
                raise DeviceError(
                    f"the sensor does not come to rest in {_RECOVERY_S:g} s with the hand open: "
                    f"{refused}. `palpate doctor` shows which pixel is at fault"
                ) from refused
            _wait(bench, bench.clock.now_s() + 5.0)
            continue
        dead = np.argwhere(~np.isfinite(rest.rest_ohm)).tolist()
        if dead:
            pixels = ", ".join(f"r{row}c{col}" for row, col in dead)
            raise DeviceError(
                f"no signal from {pixels} with the hand open; `palpate doctor` shows more"
            )
        return rest


def _take_reading(
    bench: Bench, rest: RestBaseline, moved_s: float, *, since_move_s: float, mean_s: float
) -> SheetReading:
    """Read this long after a movement: means of the last `mean_s`."""
    ohm = _ohm(bench, moved_s + since_move_s, mean_s=mean_s)
    # A pixel beyond the converter's range has at least the conductance of its last step.
    readable_ohm = np.maximum(ohm, bench.array.layout.divider.least_ohm)
    excess = np.nan_to_num(excess_conductance(readable_ohm, rest_ohm=rest.rest_ohm)).mean(axis=0)
    relative = mean_change(relative_change_percent(ohm, rest_ohm=rest.rest_ohm))
    return SheetReading(
        since_move_s=since_move_s,
        pixel_excess=tuple(excess.ravel().tolist()),
        relative_percent=float(np.mean(relative)),
        force_n=bench.cell.read_n(),
    )


def _ohm(bench: Bench, until_s: float, *, mean_s: float) -> FloatArray:
    """Return the resistances of the frames in the last `mean_s` before a time."""
    layout, found = bench.array.layout, list[FloatArray]()
    if bench.skip_until is not None:
        bench.skip_until(until_s - mean_s)
    while True:
        frame = bench.array.read(timeout_s=FRAME_TIMEOUT_S)
        if frame.time_s > until_s - mean_s:
            found.append(
                pixel_resistance_ohm(frame.counts, layout=layout, oversampling=frame.oversampling)
            )
        if frame.time_s >= until_s:
            return np.array(found)
