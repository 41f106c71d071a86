"""Guided calibration steps: rest, closing on a load cell, closing on a block."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibration import BlockPairs, ForcePairs, RestValues
from palpate.clock import Clock
from palpate.errors import CalibrationError, DeviceError, NoiseError
from palpate.gripper.interface import Gripper, GripperCommand, open_fully
from palpate.sensor.array import FRAME_TIMEOUT_S, PressureArray
from palpate.sensor.findings import pixel_name
from palpate.sensor.rest_baseline import RestBaseline, rest_baseline
from palpate.sensor.sample import SampleReader
from palpate.signal.relative import mean_change

#: Contact threshold of a load cell, newtons. Closing is slow up to contact. The steps then grow
#: with the force, to read small forces as often as large forces.
_TOUCH_N = 0.05
_POLL_S = 0.02
#: Averaging time of a reading at the end of a dwell, and of a settled hold.
_EARLY_MEAN_S, _SETTLED_MEAN_S = 0.2, 0.5
#: Largest threshold of a touch, relative to the largest force on a block.
_MAX_TOUCH_FRACTION = 0.5
#: Largest closure after the touch of a rigid block, mm or kPa: hands give way by 2 to 4 mm at 15 N.
#: Pads stiffen with the force, as a contact of elastic bodies (Hertz): at a smaller one it is less.
_MOST_TRAVEL, _TRAVEL_AT_N, _TRAVEL_EXPONENT = {"width": 5.0, "pressure": 50.0}, 15.0, 2.0 / 3.0
#: Allowance for the stiffening of pads in one step, and smallest step by an uncertain force.
_STIFFENING, _SMALLEST_SAFE = 1.5, {"width": 0.05, "pressure": 0.15}
#: Forces of the settled holds, newtons, one list per placement of the load cell, small and large
#: mixed.
HOLDS_N = ((0.4, 3.0), (0.8, 6.0), (0.3, 2.0), (1.5, 12.0), (0.6, 4.0), (2.5, 15.0))
#: Final part of a wait in which frames are read even if earlier frames are skipped.
_FINAL_READ_S = 0.2
#: Pause with the gripper open before the rest of a placement is measured.
_RECOVERY_PAUSE_S = 30.0
#: Maximum recovery time of the sheet from a load.
_MAX_RECOVERY_S = 120.0
#: Largest fraction of a reading's frames in which a pixel may be open; it is read from the others.
_MAX_OPEN_FRACTION = 0.5


class LoadCell(Protocol):
    """A reference force sensor in place of the object."""

    def read_n(self) -> float:
        """Return the present grip force, newtons."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pace:
    """Rates (mm/s, kPa/s) and steps (mm, kPa) of a closing on the load cell."""

    approach: float
    rate: float
    step_per_n: float
    smallest_step: float
    largest_step: float


_PACES = {
    "width": _Pace(approach=6.0, rate=20.0, step_per_n=0.1, smallest_step=0.1, largest_step=0.5),
    "pressure": _Pace(approach=4.0, rate=15.0, step_per_n=0.4, smallest_step=0.3, largest_step=1.5),
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
    """The devices of a calibration, and the start of slow closing.

    `array`, `gripper`, `cell`, `clock`: the devices.
    `skip_until`: waits without reading frames; without it, unneeded frames are read and dropped.
    `start`: width slightly above, or pressure slightly below, contact with the largest object.
    `approach`: rate of the search for contact, mm/s or kPa/s; by default that for a load cell,
        which sees a touch sooner than a sheet.
    """

    array: PressureArray
    gripper: Gripper
    cell: LoadCell
    clock: Clock
    start: float
    skip_until: Callable[[float], None] | None = None
    approach: float | None = None
    #: Force above which the cell shows a contact, newtons: above its noise.
    touch_n: float = _TOUCH_N
    #: Upper limit of the present force, newtons; without it the cell's force is exact.
    high_n: Callable[[], float] | None = None


def measure_rest(bench: Bench, *, duration_s: float = 2.0) -> RestValues:
    """Open the gripper and measure the rest values.

    Raises `DeviceError` if the sensor does not come to rest, or a pixel has no signal.
    """
    with _open_afterwards(bench):
        _open(bench)
        rest = wait_for_rest(bench, duration_s=duration_s)
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

    Each run is a new placement of the cell. A run closes in steps, as a grasp does, and takes a
    reading `dwell_s` after each step. At each force of its list it holds until `horizon_s` and
    reads the settled value.

    `holds_n`: for each run, the rising forces at which to hold.
    `reseat`: called with the run's number once the gripper is open; the user moves the load cell.
    `dwell_s`: wait from each step to its reading.
    `horizon_s`: time after which the sheet counts as settled.
    Raises `CalibrationError` if the load cell never measures a force, and `DeviceError` if a pixel
    has no signal.
    """
    rows: list[tuple[int, SheetReading]] = []
    with _open_afterwards(bench):
        for run, levels in enumerate(holds_n):
            _open(bench)
            reseat(run)
            rest = wait_for_rest(bench, duration_s=1.0)
            for level_n in levels:
                found, has_room = _close_to_force(
                    bench, rest, level_n, dwell_s=dwell_s, horizon_s=horizon_s
                )
                rows += [(run, reading) for reading in found]
                if not has_room:
                    break
    if not any(reading.force_n > bench.touch_n for _, reading in rows):
        raise CalibrationError(
            "force calibration: the gripper closed fully but the load cell measured no force; "
            "check that the cell is between the fingers and connected"
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
    bench: Bench,
    *,
    block_mm: float,
    up_to_n: float,
    repeats: int,
    dwell_s: float,
    tell: Callable[[str], None] | None = None,
) -> BlockPairs:
    """Close on a rigid block of known size and pair force with width or pressure.

    `tell`: called with a sentence before each closing.
    Raises `CalibrationError` if the force stays below `up_to_n` although the fingers have closed
    further than a hand gives way, or if they never touch; `NoiseError` if noise hides the block.
    """
    if bench.touch_n > _MAX_TOUCH_FRACTION * up_to_n:
        raise NoiseError(
            f"the noise of the sheet at rest reads as up to {bench.touch_n:.2g} N, and only "
            f"forces up to {up_to_n:.2g} N are used; average more conversions in the board's "
            "sketch, or use shorter wires"
        )
    limits = bench.gripper.limits
    furthest = _MOST_TRAVEL[limits.drive]
    reported: list[float] = []
    force_n: list[float] = []
    with _open_afterwards(bench):
        for number in range(1, repeats + 1):
            if tell is not None:
                tell(
                    f"closing {number} of {repeats}, about 40 s: the open hand rests for "
                    f"{_RECOVERY_PAUSE_S:g} s, then closes slowly up to {up_to_n:.3g} N"
                )
            _open(bench)
            touched_at: float | None = None
            earlier: tuple[float, float] | None = None
            while bench.cell.read_n() < up_to_n:
                step = None
                if bench.high_n is not None and touched_at is not None:
                    closure = limits.closure(bench.gripper.state())
                    step, earlier = _safe_step(bench, up_to_n, closure, earlier)
                    if step < _SMALLEST_SAFE[limits.drive]:
                        share = (bench.cell.read_n() / _TRAVEL_AT_N) ** _TRAVEL_EXPONENT
                        _check_travel(closure - touched_at, furthest * share, bench)
                        break
                if not _close_one_step(bench, at_most=step):
                    break
                _wait(bench, bench.clock.now_s() + dwell_s)
                force = bench.cell.read_n()
                closure = limits.closure(bench.gripper.state())
                if touched_at is not None:
                    _check_travel(closure - touched_at, furthest, bench)
                if force > bench.touch_n:
                    # A reading that does not last is no touch.
                    touched_at = closure if touched_at is None else touched_at
                    reported.append(limits.drive_reading(bench.gripper.state()))
                    force_n.append(force)
    if not force_n:
        raise CalibrationError(
            "the fingers closed completely and no force was measured: is a rigid block between "
            "the pads, and does the sensor respond?"
        )
    by_width = limits.drive == "width"
    return BlockPairs(
        block_mm=(block_mm,) * len(reported),
        width_mm=tuple(reported) if by_width else (),
        force_n=tuple(force_n),
        pressure_kpa=() if by_width else tuple(reported),
    )


def _check_travel(travel: float, furthest: float, bench: Bench) -> None:
    """Raise `CalibrationError` if the hand closed further than it gives way at this force."""
    if travel > furthest:
        unit = "mm" if bench.gripper.limits.drive == "width" else "kPa"
        raise CalibrationError(
            f"the force is {bench.cell.read_n():.1f} N although the fingers have closed "
            f"{travel:.1f} {unit} since the touch: is a rigid block between the pads, and does the "
            "sensor still respond?"
        )


@contextmanager
def _open_afterwards(bench: Bench) -> Iterator[None]:
    """Open the gripper at the end, also after an error."""
    try:
        yield
    finally:
        open_fully(bench.gripper, clock=bench.clock)


def _close_to_force(
    bench: Bench, rest: RestBaseline, level_n: float, *, dwell_s: float, horizon_s: float
) -> tuple[list[SheetReading], bool]:
    """Close in steps to a force and settle; return the readings and whether travel remains."""
    readings: list[SheetReading] = []
    moved_s, has_room = bench.clock.now_s(), True
    while has_room and bench.cell.read_n() < level_n:
        searching = bench.cell.read_n() < bench.touch_n
        moved_s = bench.clock.now_s()
        has_room = _close_one_step(bench)
        # The search for contact is slow; the sheet responds only at its end.
        moved_s = bench.clock.now_s() if searching else moved_s
        if has_room:
            reading = _take_reading(
                bench, rest, moved_s, since_move_s=dwell_s, mean_s=_EARLY_MEAN_S
            )
            if reading.force_n > bench.touch_n:
                readings.append(reading)
    settled = _take_reading(bench, rest, moved_s, since_move_s=horizon_s, mean_s=_SETTLED_MEAN_S)
    return [*readings, settled], has_room


def _open(bench: Bench) -> None:
    """Open slightly beyond the object between the fingers and let the sheet recover."""
    if bench.gripper.limits.closure(bench.gripper.state()) > _free_closure(bench):
        _move_to(bench, _free_closure(bench))
    # The opening spike and the residual of the last load must decay: after 3 s a rest value may
    # still have an error of 3 %, the equivalent of half a newton.
    _wait(bench, bench.clock.now_s() + _RECOVERY_PAUSE_S)


def _safe_step(
    bench: Bench, up_to_n: float, closure: float, earlier: tuple[float, float] | None
) -> tuple[float, tuple[float, float]]:
    """Return the step after which the upper limit of the force is `up_to_n`, and the present point.

    The stiffness is that of the last step, with an allowance.
    """
    assert bench.high_n is not None
    high_n = bench.high_n()
    step = _PACES[bench.gripper.limits.drive].smallest_step
    if earlier is not None and closure > earlier[0] and high_n > earlier[1]:
        per_unit = _STIFFENING * (high_n - earlier[1]) / (closure - earlier[0])
        step = (up_to_n - high_n) / per_unit
    return (step if high_n < up_to_n else 0.0), (closure, high_n)


def _close_one_step(bench: Bench, *, at_most: float | None = None) -> bool:
    """Close by one step; return whether enough travel remained."""
    limits, force_n = bench.gripper.limits, bench.cell.read_n()
    pace, closure = _PACES[limits.drive], limits.closure(bench.gripper.state())
    if closure >= limits.span - 0.5 * pace.smallest_step:
        return False
    if force_n < bench.touch_n:
        if closure < _free_closure(bench):
            _move_to(bench, _free_closure(bench))
        rate = bench.approach or pace.approach
        bench.gripper.command(GripperCommand(target=limits.target(limits.span), rate=rate))
        while bench.gripper.state().moving and bench.cell.read_n() < bench.touch_n:
            bench.clock.sleep_s(_POLL_S)
        bench.gripper.stop()
        return True
    step = min(max(pace.step_per_n * force_n, pace.smallest_step), pace.largest_step)
    step = step if at_most is None else min(step, at_most)
    _move_to(bench, closure + step)
    return True


def _free_closure(bench: Bench) -> float:
    """Return the largest closure without contact."""
    return abs(bench.start - bench.gripper.limits.target(0.0))


def _move_to(bench: Bench, closure: float) -> None:
    limits = bench.gripper.limits
    rate = _PACES[limits.drive].rate
    travel = abs(closure - limits.closure(bench.gripper.state()))
    bench.gripper.command(GripperCommand(target=limits.target(closure), rate=rate))
    bench.clock.sleep_s(travel / rate)
    while bench.gripper.state().moving:
        bench.clock.sleep_s(_POLL_S)


def _wait(bench: Bench, until_s: float) -> None:
    """Read and drop frames until a time, so the next frame is recent."""
    if bench.skip_until is not None:
        bench.skip_until(until_s - _FINAL_READ_S)
    while bench.array.read(timeout_s=FRAME_TIMEOUT_S).time_s < until_s:
        pass


def wait_for_rest(bench: Bench, *, duration_s: float) -> RestBaseline:
    """Measure rest values after the sheet has recovered from the last load.

    Raises `DeviceError` if the sensor does not come to rest, or a pixel has no signal; `NoiseError`
    if its noise hides whether it does, which waiting does not change.
    """
    deadline_s = bench.clock.now_s() + _MAX_RECOVERY_S
    while True:
        ohm = _ohm(bench, bench.clock.now_s() + duration_s, mean_s=duration_s)
        try:
            rest = rest_baseline(ohm)
        except NoiseError:
            raise
        except CalibrationError as refused:
            if bench.clock.now_s() > deadline_s:
                raise DeviceError(
                    f"the sensor does not come to rest in {_MAX_RECOVERY_S:g} s with the gripper "
                    f"open: {refused}. `palpate doctor` shows the faulty pixel"
                ) from refused
            _wait(bench, bench.clock.now_s() + 5.0)
            continue
        dead = np.argwhere(~np.isfinite(rest.rest_ohm)).tolist()
        if dead:
            pixels = ", ".join(pixel_name(row, col) for row, col in dead)
            raise DeviceError(
                f"no signal from {pixels} with the gripper open; run `palpate doctor` for details"
            )
        return rest


def _take_reading(
    bench: Bench, rest: RestBaseline, moved_s: float, *, since_move_s: float, mean_s: float
) -> SheetReading:
    """Take a reading `since_move_s` after a movement, averaged over the last `mean_s`."""
    ohm = _ohm(bench, moved_s + since_move_s, mean_s=mean_s)
    pixels = SampleReader(bench.array.layout, rest.rest_ohm).read_ohm(ohm)
    lost = pixels.open.mean(axis=0) > _MAX_OPEN_FRACTION
    if lost.any():
        names = ", ".join(pixel_name(row, col) for row, col in np.argwhere(lost).tolist())
        raise DeviceError(
            f"no signal from {names} at {bench.cell.read_n():.2g} N; run `palpate doctor` for "
            "details"
        )
    excess = np.nanmean(pixels.excess, axis=0)
    relative = mean_change(pixels.change_percent)
    return SheetReading(
        since_move_s=since_move_s,
        pixel_excess=tuple(excess.ravel().tolist()),
        relative_percent=float(np.mean(relative)),
        force_n=bench.cell.read_n(),
    )


def _ohm(bench: Bench, until_s: float, *, mean_s: float) -> FloatArray:
    """Return the resistances of the frames in the last `mean_s` before a time."""
    reader, found = SampleReader(bench.array.layout), list[FloatArray]()
    if bench.skip_until is not None:
        bench.skip_until(until_s - mean_s)
    while True:
        frame = bench.array.read(timeout_s=FRAME_TIMEOUT_S)
        if frame.time_s > until_s - mean_s:
            found.append(reader.read(frame).resistance_ohm)
        if frame.time_s >= until_s:
            return np.array(found)
