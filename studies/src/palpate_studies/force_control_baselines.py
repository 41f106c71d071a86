"""The simpler ways to grip: a threshold and a fixed closing, and the servo's current alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.gripper.interface import GripperCommand
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import (
    CONTACT_PERCENT,
    finger_means,
    mean_change,
    relative_change_percent,
)
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import GripperKind, World
from palpate_studies.force_control_grasps import LIFTED_S, NEAR, Gripped, damaged
from palpate_studies.force_control_world import GRASPS_PER_SHEET, Task, chance_of_damage
from palpate_studies.protocol.parts import Learned, choose

#: The paper's way: after contact close further by a fixed amount, mm or kPa; those tried.
_EXTRAS: dict[GripperKind, tuple[float, ...]] = {
    "rigid": (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.4, 3.0, 4.0),
    "soft": (0.0, 1.5, 3.0, 4.5, 6.0, 9.0, 12.0),
}
_STEP: dict[GripperKind, float] = {"rigid": 1.0, "soft": 0.8}
_RATE: dict[GripperKind, float] = {"rigid": 20.0, "soft": 15.0}
_DWELL_S = 0.42
#: Closing by current alone: finer steps, and readings averaged at each.
_FINE_MM, _READINGS = 0.25, 5


def best_fixed(task: Task, extra: Learned[float]) -> Gripped:
    """Close by the fixed amount that was best on other things; refused on those themselves."""
    return fixed_extra(task, extra=extra.on([_thing(task)]))


def chosen_extra(tasks: Sequence[Task]) -> Learned[float]:
    """Return the fixed closing that comes within 10 % most often, then nearest in the median."""

    def loss(extra: float) -> tuple[float, float]:
        off = np.abs([fixed_extra(task, extra=extra).off_target for task in tasks])
        return float(np.mean(off > NEAR)), float(np.median(off))

    return choose(_EXTRAS[tasks[0].kind], loss=loss, on=map(_thing, tasks))


def _thing(task: Task) -> str:
    return f"{task.level} {task.seed}"


def fixed_extra(task: Task, *, extra: float) -> Gripped:
    """Close in steps until the mean change passes the threshold, then by a fixed amount (4.1)."""
    world = task.world()
    array, gripper = TwinArray(world), TwinGripper(world)
    rest_ohm = read_ohm(array, seconds=0.5)
    touched = touched_by(array, world, rest_ohm)
    closed = close_until(world, gripper, touched, step=_STEP[task.kind], kind=task.kind)
    drive(world, gripper, closed + extra, kind=task.kind)
    return blindly_lifted(world, task, method="best fixed extra closing")


def touched_by(
    array: TwinArray, world: World, rest_ohm: NDArray[np.float64], *, both_fingers: bool = False
) -> Callable[[], bool]:
    """Return a check, after each step, whether the sheet passes the paper's threshold.

    The mean over all pixels has to (section 2.1); with `both_fingers` the mean of each finger.
    """

    def touched() -> bool:
        change = relative_change_percent(read_ohm(array, seconds=_DWELL_S), rest_ohm=rest_ohm)
        if both_fingers:
            fingers = finger_means(change, finger_of_row=world.layout.finger_of_row)
            return bool(np.all(fingers <= CONTACT_PERCENT))
        return bool(mean_change(change) <= CONTACT_PERCENT)

    return touched


def by_current(task: Task) -> Gripped:
    """Close in fine steps until the servo's current gives the target; rigid fingers only."""
    world = task.world()
    gripper = TwinGripper(world)
    zero_ma, ma_per_n = current_line(task.seed // GRASPS_PER_SHEET, task.level)

    def reached() -> bool:
        world.clock.sleep_s(_DWELL_S)
        return _current_ma(gripper, world) >= zero_ma + ma_per_n * task.target_n

    close_until(world, gripper, reached, step=_FINE_MM, kind="rigid")
    return blindly_lifted(world, task, method="motor current alone")


@lru_cache(maxsize=2)
def current_line(sheet: int, level: str) -> tuple[float, float]:
    """Calibrate current against a load cell, in another session: zero (mA) and slope (mA/N)."""
    world = World(None, seed=sheet + 1_000_003, sheet_seed=sheet, level=level)
    world.place(draw_object(np.random.default_rng([sheet, 35]), "ball-44lbs"))
    gripper, cell = TwinGripper(world), TwinLoadCell(world)
    rows = list[tuple[float, float]]()

    def enough() -> bool:
        world.clock.sleep_s(_DWELL_S)
        force_n = cell.read_n()
        if force_n > 0.5:
            rows.append((force_n, _current_ma(gripper, world)))
        return force_n > 10.0

    drive(world, gripper, 22.0, kind="rigid")
    close_until(world, gripper, enough, step=_FINE_MM, kind="rigid")
    force_n, current_ma = np.array(rows).T
    slope, zero = np.polyfit(force_n, current_ma, 1)
    return float(zero), max(float(slope), 1.0)


def _current_ma(gripper: TwinGripper, world: World) -> float:
    readings = []
    for _ in range(_READINGS):
        readings.append(gripper.state().current_ma)
        world.clock.sleep_s(0.02)
    return float(np.mean(readings))


def read_ohm(array: TwinArray, *, seconds: float, last: int | None = None) -> NDArray[np.float64]:
    """Wait, and return the mean resistance of the last three frames, or as many last frames."""
    count = max(int(seconds * 15), 3)
    frames = [array.read(timeout_s=1.0) for _ in range(count)]
    kept = frames[-3:] if last is None else frames[-last:]
    ohm = [pixel_resistance_ohm(f.counts, layout=array.layout, oversampling=1) for f in kept]
    return np.asarray(np.mean(ohm, axis=0) if last is None else ohm)


def close_until(
    world: World,
    gripper: TwinGripper,
    done: Callable[[], bool],
    *,
    step: float,
    kind: GripperKind,
) -> float:
    """Close step by step until `done`, or the hand is closed; return the closure."""
    closed = gripper.limits.closure(gripper.state())
    while closed < gripper.limits.span - step:
        closed += step
        drive(world, gripper, closed, kind=kind)
        if done():
            break
    return closed


def drive(world: World, gripper: TwinGripper, closure: float, *, kind: GripperKind) -> float:
    """Go to a closure and wait until the hand is there; return the servo current on the way, mA."""
    limits = gripper.limits
    closure = min(closure, limits.span)
    way = abs(closure - limits.closure(gripper.state()))
    gripper.command(GripperCommand(target=limits.target(closure), rate=_RATE[kind]))
    world.clock.sleep_s(0.9 * way / _RATE[kind])
    current_ma = gripper.state().current_ma
    world.clock.sleep_s(0.1 * way / _RATE[kind] + 0.05)
    return current_ma


def blindly_lifted(
    world: World,
    task: Task,
    *,
    method: str,
    said_n: float | None = None,
    on_target_s: float | None = None,
) -> Gripped:
    """Lift whatever is between the fingers, hold it, and return the outcome."""
    world.clock.sleep_s(1.0)
    world.lift()
    world.clock.sleep_s(LIFTED_S)
    world.force_n(world.now_s())
    truth = world.truth()
    return Gripped(
        task=task,
        method=method,
        outcome="lifted",
        lifted=True,
        dropped=world.dropped,
        force_n=truth.force_n,
        damaged=damaged(world, task),
        said_n=said_n,
        on_target_s=on_target_s,
        risk=chance_of_damage(task.obj, truth.peak_force_n),
    )
