"""Steps of the simpler ways to grip: close to a threshold, move, lift."""

from __future__ import annotations

from collections.abc import Callable

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
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import GripperKind, World
from palpate_studies.force_control_grasps import LIFTED_S, Gripped, damaged
from palpate_studies.force_control_world import Task

_RATE: dict[GripperKind, float] = {"rigid": 20.0, "soft": 15.0}
_DWELL_S = 0.42


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
    )
