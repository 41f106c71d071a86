"""The paper's own proposal as a rival: its line with an early settled value as feedback.

Section 3.3 of the paper fits force to the settled mean relative change by a line (Table 4), and
proposes to grip to a force with that reading as feedback. No such loop is
printed. Here it is in its strongest plain form: contact as in Figure 13, then corrections by the
secant through the last two answers, up or down, until the line reads the target.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.line_law import LineForceLaw, fit_settled_line
from palpate.grasp.planning import HORIZON_S
from palpate.settling.exponential import Exponential
from palpate.signal.relative import mean_change, relative_change_percent
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import GripperKind, World
from palpate_studies.force_control_baselines import (
    blindly_lifted,
    close_until,
    drive,
    read_ohm,
    touched_by,
)
from palpate_studies.force_control_grasps import Gripped, calibration_of
from palpate_studies.force_control_world import GRASPS_PER_SHEET, Task

#: Steps of the approach, as of the fixed closing; corrections go by no more than one such step, and
#: by no less than what a servo or regulator resolves.
_STEP: dict[GripperKind, float] = {"rigid": 1.0, "soft": 0.8}
_LEAST: dict[GripperKind, float] = {"rigid": 0.05, "soft": 0.2}
#: Taken to be on target within this share; corrections at most.
_CLOSE_ENOUGH, _MOST_MOVES = 0.05, 12
_FRAME_RATE_HZ = 15


#: Closure, and the servo's current on the way there (mA) -> force, N.
ForceReader: TypeAlias = Callable[[float, float], float]

NAME, WAITS_S = "the paper's line, exponential at 2.5 s", 2.5


def paper_loop(task: Task) -> Gripped:
    """Close to contact, then correct until the line reads the target, and lift."""
    law = _line(task.seed // GRASPS_PER_SHEET, task.level, task.kind)

    def reader(array: TwinArray, _gripper: TwinGripper, rest_ohm: FloatArray) -> ForceReader:
        return lambda _closure, _current_ma: _read(array, rest_ohm, law)

    return corrected(task, name=NAME, reader=reader)


def corrected(
    task: Task,
    *,
    name: str,
    reader: Callable[[TwinArray, TwinGripper, FloatArray], ForceReader],
    world: World | None = None,
) -> Gripped:
    """Close to contact, correct until a reading of the force is on target, and lift.

    Parameters
    ----------
    task : Task
        What is gripped.
    name : str
        Of the method.
    reader : callable
        Array, gripper and rest values, shape (rows, cols) -> what reads the force after each move.
    world : World, optional
        The task's, where the caller looks into it too.
    """
    world = task.world() if world is None else world
    array, gripper, kind = TwinArray(world), TwinGripper(world), task.kind
    rest_ohm = read_ohm(array, seconds=0.5)
    closed = close_until(
        world, gripper, touched_by(array, world, rest_ohm), step=_STEP[kind], kind=kind
    )
    touched_s, force_n = world.clock.now_s(), reader(array, gripper, rest_ohm)
    reading_n, step = force_n(closed, gripper.state().current_ma), _STEP[kind] / 2
    on_target_s = None
    for _ in range(_MOST_MOVES):
        if abs(reading_n / task.target_n - 1.0) <= _CLOSE_ENOUGH:
            on_target_s = world.clock.now_s() - touched_s
            break
        step = _bounded(step, missing_n=task.target_n - reading_n, kind=kind)
        closed = float(np.clip(closed + step, 0.0, gripper.limits.span))
        current_ma = drive(world, gripper, closed, kind=kind)
        before_n, reading_n = reading_n, force_n(closed, current_ma)
        # The secant through the last two answers; a reading that did not follow asks for as much
        # again in the same direction.
        slope = (reading_n - before_n) / step
        step = (task.target_n - reading_n) / slope if slope > 1e-3 else _STEP[kind]
    return blindly_lifted(world, task, method=name, said_n=reading_n, on_target_s=on_target_s)


def _bounded(step: float, *, missing_n: float, kind: GripperKind) -> float:
    """Return a move in the direction of what is missing, not too large and not too small."""
    size = float(np.clip(abs(step), _LEAST[kind], _STEP[kind]))
    return size if missing_n > 0 else -size


def _read(array: TwinArray, rest_ohm: FloatArray, law: LineForceLaw) -> float:
    """Wait after a move and return the force that the line gives for the forecast."""
    frames = int(WAITS_S * _FRAME_RATE_HZ)
    ohm = read_ohm(array, seconds=WAITS_S, last=frames)
    change = mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))
    time_s = np.arange(1, len(change) + 1) / _FRAME_RATE_HZ
    found = Exponential().predict(time_s, change[None], horizon_s=20.0, level=0.9)
    return float(law.force_n(np.asarray(found.value)[0]).value)


@lru_cache(maxsize=4)
def _line(sheet: int, level: str, kind: GripperKind) -> LineForceLaw:
    """Fit the line to the settled pairs of the same calibration that ours uses."""
    return fit_settled_line(calibration_of(sheet, level, kind).force, horizon_s=HORIZON_S)
