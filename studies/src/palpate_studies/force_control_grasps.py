"""One task gripped by the controller, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from palpate.estimate.damage import DamageModel
from palpate.grasp.phases import Phase
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import Calibration
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import GripperKind, World
from palpate_studies.force_control_world import GRASPS_PER_SHEET, Task
from palpate_studies.stoppable import uninterrupted

#: Near enough to the target.
NEAR = 0.1
#: Name of the method that knows no damage limit.
UNLIMITED = "ours, no damage limit"
#: Held this long in the air before it is given back, seconds.
LIFTED_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Gripped:
    """The outcome of one task; None where the method gives or does nothing of the kind.

    Attributes
    ----------
    method, outcome : str
        How it was gripped, and how that ended.
    force_n : float
        True settled force of the final hold.
    said_n, low_n, high_n : float or None
        The settled force that was reported, and its interval.
    lifted, dropped, damaged, limited : bool
        Whether it was lifted, fell, was pressed beyond its yield, and whether the damage limit kept
        the force below the target.
    on_target_s : float or None
        From contact until it was first reported on target after the last movement.
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
    return _controlled(task, method="ours", damage=damage)


def unlimited(task: Task) -> Gripped:
    """Grip with the controller as shipped where no damage limit was learned, as its rivals do."""
    return _controlled(task, method=UNLIMITED, damage=None)


def _controlled(task: Task, *, method: str, damage: DamageModel | None) -> Gripped:
    world = task.world()
    gripper, lifted = TwinGripper(world), list[float]()

    def arm(grasp_state: GraspState) -> None:
        if grasp_state.phase is Phase.HOLD and not lifted:
            lifted.append(grasp_state.estimate.now_s)
            world.lift()

    plan = plan_grasp(
        calibration_of(task.seed // GRASPS_PER_SHEET, task.level, task.kind),
        gripper=gripper,
        target_force_n=task.target_n,
        lift_force_n=task.lift_n,
        damage=damage,
        hold_s=LIFTED_S,
        longest_s=300.0,
    )
    array = TwinArray(world)
    result = uninterrupted(
        run_grasp(plan, array=array, gripper=gripper, clock=world.clock, watchers=[arm])
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
        limited=result.limited,
        on_target_s=_on_target_s(result),
        force_n=truth.force_n,
        damaged=damaged(world, task),
    )


def damaged(world: World, task: Task) -> bool:
    return world.truth().peak_force_n >= task.obj.yield_n


def _on_target_s(result: GraspResult) -> float | None:
    """Return the time from contact to the last statement of being on target."""
    at = {moment.name: moment.time_s for moment in result.moments if moment.finger is None}
    if "contact" not in at or at.get("on_target", -1.0) < at.get("adjusted", -1.0):
        return None
    return at["on_target"] - at["contact"] if "on_target" in at else None


@lru_cache(maxsize=2)
def calibration_of(sheet: int, level: str, kind: GripperKind) -> Calibration:
    """Calibrate a sensor and gripper by a user's steps; the grasps of one sheet share it."""
    return calibrate_twin(seed=sheet, level=level, apart_from="", kind=kind)
