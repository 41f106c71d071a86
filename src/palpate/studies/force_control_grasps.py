"""One task gripped by ours and by each simpler way, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.damage import DamageModel
from palpate.grasp.belief import Belief
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import HORIZON_S, plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import GripperCommand
from palpate.rig.simulated import calibrated
from palpate.sensor.calibration import Calibration
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.settling.recorded import Recorded
from palpate.signal.relative import CONTACT_PERCENT, finger_means, relative_change_percent
from palpate.studies.force_control_world import GRASPS_PER_SHEET, Task, chance_of_damage
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import GripperKind, World

#: Near enough to the target.
NEAR = 0.1
#: Held so long in the air before it is given back, seconds.
_LIFTED_S = 3.0
#: The paper's way: after contact close further by a fixed amount, right for the middle of the
#: population (3.5 N on 5 N/mm in series with the gripper).
_EXTRA: dict[GripperKind, float] = {"rigid": 1.6, "soft": 9.0}
_STEP: dict[GripperKind, float] = {"rigid": 1.0, "soft": 0.8}
_RATE: dict[GripperKind, float] = {"rigid": 20.0, "soft": 15.0}
_DWELL_S = 0.42
#: Closing by current alone: finer steps, and readings averaged at each.
_FINE_MM, _READINGS = 0.25, 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Gripped:
    """What came of one task; None where the method says or does nothing of the kind.

    Attributes
    ----------
    method, outcome : str
        How it was gripped, and how that ended.
    force_n : float
        True settled force of the final hold.
    said_n, low_n, high_n : float or None
        The settled force that was said, and its interval.
    lifted, dropped, damaged, limited : bool
        Whether it was lifted, fell, was pressed beyond its yield, and whether the damage limit kept
        the force below the target.
    on_target_s : float or None
        From contact until it was first said to be on target after the last movement.
    touch_risk, risk : float
        Share of such things that yield under the force at which the touch was confirmed, and under
        the largest force of the grasp (`force_control_world.chance_of_damage`).
    """

    task: Task
    method: str
    outcome: str
    force_n: float
    lifted: bool
    dropped: bool
    damaged: bool
    said_n: float | None = None
    low_n: float | None = None
    high_n: float | None = None
    limited: bool = False
    on_target_s: float | None = None
    touch_risk: float = 0.0
    risk: float = 0.0

    @property
    def could_bear(self) -> bool:
        """Whether the thing would have borne the target, and what counts as near it."""
        return self.task.obj.yield_n > (1.0 + NEAR) * self.task.target_n

    @property
    def off_target(self) -> float:
        """Settled force over target, less 1."""
        return self.force_n / self.task.target_n - 1.0


def ours(task: Task, *, damage: DamageModel) -> Gripped:
    """Grip with the controller as shipped."""
    return _controlled(task, lambda plan: plan, method="ours", damage=damage)


def waiting(task: Task, *, damage: DamageModel) -> Gripped:
    """Grip with the same controller, but wait for the settled value after each movement."""
    until_s = HORIZON_S - 0.5

    def patient(plan: Plan) -> Plan:
        return replace(
            plan,
            settling=Recorded(),
            correct_after_s=until_s,
            decide_after_s=until_s,
            decide_by_s=until_s,
        )

    return _controlled(task, patient, method="wait 20 s after each move", damage=damage)


def _controlled(
    task: Task, change: Callable[[Plan], Plan], *, method: str, damage: DamageModel
) -> Gripped:
    world = task.world()
    gripper, lifted, touched_n = TwinGripper(world), list[float](), list[float]()

    def arm(belief: Belief) -> None:
        if belief.phase is Phase.CONTACT and not touched_n:
            touched_n.append(world.force_n(belief.now_s))
        if belief.phase is Phase.HOLD and not lifted:
            lifted.append(belief.now_s)
            world.lift()

    plan = plan_grasp(
        _calibration(task),
        gripper=gripper,
        target_force_n=task.target_n,
        lift_force_n=task.lift_n,
        damage=damage,
        hold_s=_LIFTED_S,
        longest_s=300.0,
    )
    result = run_grasp(
        change(plan), array=TwinArray(world), gripper=gripper, clock=world.clock, watchers=[arm]
    )
    force, truth = result.force_n, world.truth()
    return Gripped(
        task=task,
        method=method,
        outcome=str(result.outcome),
        lifted=bool(lifted),
        dropped=world.dropped,
        said_n=None if force is None else force.value,
        low_n=None if force is None else force.low,
        high_n=None if force is None else force.high,
        limited=any(moment.name == "damage_limit" for moment in result.moments),
        on_target_s=_on_target_s(result),
        force_n=truth.force_n,
        damaged=_damaged(world, task),
        touch_risk=chance_of_damage(task.obj, sum(touched_n)),
        risk=chance_of_damage(task.obj, truth.peak_force_n),
    )


def _damaged(world: World, task: Task) -> bool:
    return world.truth().peak_force_n >= task.obj.yield_n


def _on_target_s(result: GraspResult) -> float | None:
    """Return the time from contact to the last statement of being on target."""
    at = {moment.name: moment.time_s for moment in result.moments if moment.finger is None}
    if "contact" not in at or at.get("on_target", -1.0) < at.get("adjusted", -1.0):
        return None
    return at["on_target"] - at["contact"] if "on_target" in at else None


def _calibration(task: Task) -> Calibration:
    return _calibrated(task.seed // GRASPS_PER_SHEET, task.level, task.kind)


@lru_cache(maxsize=2)
def _calibrated(sheet: int, level: str, kind: GripperKind) -> Calibration:
    return calibrated(seed=sheet, level=level, apart_from="", kind=kind)


def fixed_extra(task: Task) -> Gripped:
    """Close in steps until a finger's change passes the threshold, then by a fixed amount (4.1)."""
    world = task.world()
    array, gripper = TwinArray(world), TwinGripper(world)
    rest_ohm = _ohm(array, seconds=0.5)

    def touched() -> bool:
        change = relative_change_percent(_ohm(array, seconds=_DWELL_S), rest_ohm=rest_ohm)
        fingers = finger_means(change, finger_of_row=world.layout.finger_of_row)
        return float(np.nanmin(fingers)) <= CONTACT_PERCENT

    closed = _close_until(world, gripper, touched, step=_STEP[task.kind], kind=task.kind)
    _drive(world, gripper, closed + _EXTRA[task.kind], kind=task.kind)
    return _blindly_lifted(world, task, method="threshold and fixed extra closing")


def by_current(task: Task) -> Gripped:
    """Close in fine steps until the servo's current says the target; rigid fingers only."""
    world = task.world()
    gripper = TwinGripper(world)
    zero_ma, ma_per_n = _current_line(task.seed // GRASPS_PER_SHEET, task.level)

    def reached() -> bool:
        world.clock.sleep_s(_DWELL_S)
        return _current_ma(gripper, world) >= zero_ma + ma_per_n * task.target_n

    _close_until(world, gripper, reached, step=_FINE_MM, kind="rigid")
    return _blindly_lifted(world, task, method="motor current alone")


@lru_cache(maxsize=2)
def _current_line(sheet: int, level: str) -> tuple[float, float]:
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

    _drive(world, gripper, 22.0, kind="rigid")
    _close_until(world, gripper, enough, step=_FINE_MM, kind="rigid")
    force_n, current_ma = np.array(rows).T
    slope, zero = np.polyfit(force_n, current_ma, 1)
    return float(zero), max(float(slope), 1.0)


def _current_ma(gripper: TwinGripper, world: World) -> float:
    readings = []
    for _ in range(_READINGS):
        readings.append(gripper.state().current_ma)
        world.clock.sleep_s(0.02)
    return float(np.mean(readings))


def _ohm(array: TwinArray, *, seconds: float) -> NDArray[np.float64]:
    """Wait, and return the mean resistance of the last three frames."""
    count = max(int(seconds * 15), 3)
    frames = [array.read(timeout_s=1.0) for _ in range(count)][-3:]
    ohm = [pixel_resistance_ohm(f.counts, layout=array.layout, oversampling=1) for f in frames]
    return np.asarray(np.mean(ohm, axis=0))


def _close_until(
    world: World,
    gripper: TwinGripper,
    done: Callable[[], bool],
    *,
    step: float,
    kind: GripperKind,
) -> float:
    """Close step by step until something says so, or the hand is closed; return the closure."""
    closed = gripper.limits.closure(gripper.state())
    while closed < gripper.limits.span - step:
        closed += step
        _drive(world, gripper, closed, kind=kind)
        if done():
            break
    return closed


def _drive(world: World, gripper: TwinGripper, closure: float, *, kind: GripperKind) -> None:
    limits = gripper.limits
    closure = min(closure, limits.span)
    way = abs(closure - limits.closure(gripper.state()))
    gripper.command(GripperCommand(target=limits.target(closure), rate=_RATE[kind]))
    world.clock.sleep_s(way / _RATE[kind] + 0.05)


def _blindly_lifted(world: World, task: Task, *, method: str) -> Gripped:
    """Lift whatever is between the fingers, hold it, and say what came of it."""
    world.clock.sleep_s(1.0)
    world.lift()
    world.clock.sleep_s(_LIFTED_S)
    world.force_n(world.now_s())
    truth = world.truth()
    return Gripped(
        task=task,
        method=method,
        outcome="lifted",
        lifted=True,
        dropped=world.dropped,
        force_n=truth.force_n,
        damaged=_damaged(world, task),
        risk=chance_of_damage(task.obj, truth.peak_force_n),
    )


def gripped(tasks: Sequence[Task], *, damage: DamageModel, compared: int) -> list[Gripped]:
    """Grip every task by ours, and the first ones in every other way that their hand allows."""
    found = [ours(one, damage=damage) for one in tasks]
    for one in tasks[:compared]:
        found += [waiting(one, damage=damage), fixed_extra(one)]
        if one.kind == "rigid":
            found.append(by_current(one))
    return found
