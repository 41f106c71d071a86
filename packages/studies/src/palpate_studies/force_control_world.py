"""Draw random objects, grip them to a force with the controller and lift them.

The damage limit comes from a simulated test stand, the force law from a simulated calibration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.calibration import Calibration
from palpate.grasp.phases import Phase
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.object.damage import DamageModel, fit_damage_model
from palpate.object.strength import ClosingCurve, ClosingState
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.friction import N_PER_G
from palpate.twin.mechanics import object_force_n
from palpate.twin.objects import FRICTION, ContactShape, TwinObject
from palpate.twin.ranges import draw_log_uniform, draw_uniform
from palpate.twin.rig import calibrate_twin
from palpate.twin.velostat import Environment
from palpate.twin.world import GripperKind, World
from palpate_studies.stoppable import require_uninterrupted

#: Number of grasps that share a sensor, a gripper and their calibration.
GRASPS_PER_SHEET = 4
#: Largest relative error that counts as on target.
NEAR = 0.1
#: Name of the method without a damage limit.
UNLIMITED = "ours, no damage limit"
#: Time in the air before the release, seconds.
LIFTED_S = 3.0
#: Force at 1 mm, two decades, newtons.
STIFFNESS_N = (0.5, 50.0)
#: Sizes within the stroke; soft fingers need part of the stroke to press.
SIZES_MM: dict[str, tuple[float, float]] = {"rigid": (25.0, 60.0), "soft": (42.0, 60.0)}
#: Target forces; below the first, a sheet of the level `lab` may show no change.
TARGETS_N = (1.5, 8.0)
#: Deformation at yield, mm: median and log sd. Stiffness and strength are then correlated about as
#: in recorded fruit.
_YIELD_MM, _YIELD_LOG_SD = 4.0, 0.45
#: Fraction of objects that relax like fruit; relaxation of these and of other objects.
_FRUIT_FRACTION, _FRUIT_RELAXES, _OTHERS_RELAX = 0.5, (0.10, 0.35), (0.0, 0.05)
#: Force required for lifting as a fraction of the target, at the lowest friction.
_LIFT_FRACTION = (0.2, 0.6)
#: Largest wear of the sheet since its calibration, contacts.
_CYCLES = 300
#: Training objects of the damage limit, pressed until they yield.
PRESSED = 120
_STEP_MM, _PRESS_UP_TO_N = 0.02, 60.0
#: Readings of a closing curve: force step, noise of force (log sd) and closure (mm), first force.
#: No gain error is added, because the hand accounts for its own gain uncertainty.
_RISE_N, _WOBBLE, _CLOSURE_SD_MM, _FIRST_READING_N = 0.7, 0.08, 0.03, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One object, its target force, and the force required to lift it."""

    seed: int
    level: str
    kind: GripperKind
    obj: TwinObject
    target_n: float
    lift_n: float

    def world(self) -> World:
        """Return the world of this grasp, on a sheet worn since its calibration."""
        cycles = int(np.random.default_rng([self.seed, 33]).integers(_CYCLES))
        return World(
            self.obj,
            seed=self.seed,
            sheet_seed=self.seed // GRASPS_PER_SHEET,
            level=self.level,
            gripper=self.kind,
            environment=Environment(cycles=cycles),
        )


def draw_task(seed: int, *, level: str) -> Task:
    """Draw one task; every fourth sensor is on soft fingers."""
    rng = np.random.default_rng([seed, 31])
    kind: GripperKind = "soft" if (seed // GRASPS_PER_SHEET) % 4 == 3 else "rigid"
    target_n = draw_log_uniform(rng, TARGETS_N)
    lift_n = target_n * draw_uniform(rng, _LIFT_FRACTION)
    mass_g = 2.0 * FRICTION[0] * lift_n / N_PER_G
    obj = draw_random_object(rng, size_mm=SIZES_MM[kind], mass_g=mass_g)
    return Task(seed=seed, level=level, kind=kind, obj=obj, target_n=target_n, lift_n=lift_n)


def draw_random_object(
    rng: np.random.Generator, *, size_mm: tuple[float, float], mass_g: float = 50.0
) -> TwinObject:
    """Draw an object of any stiffness, shape and strength."""
    contact: ContactShape = "hertz" if rng.random() < 0.5 else "linear"
    force_at_1mm_n = draw_log_uniform(rng, STIFFNESS_N)
    relaxing = _FRUIT_RELAXES if rng.random() < _FRUIT_FRACTION else _OTHERS_RELAX
    yield_mm = _YIELD_MM * float(np.exp(_YIELD_LOG_SD * rng.standard_normal()))
    yield_n = force_at_1mm_n * yield_mm ** (1.5 if contact == "hertz" else 1.0)
    return TwinObject(
        name="thing",
        size_mm=draw_uniform(rng, size_mm),
        contact=contact,
        force_at_1mm_n=force_at_1mm_n,
        relaxing_fractions=tuple(
            (rng.dirichlet((2.0, 2.0, 2.0)) * draw_uniform(rng, relaxing)).tolist()
        ),
        relaxing_time_s=tuple(draw_log_uniform(rng, pair) for pair in ((0.2, 1), (1, 8), (8, 80))),
        flat=bool(rng.random() < 0.5),
        yield_n=yield_n,
        rupture_n=1.2 * yield_n,
        mass_g=mass_g,
        friction=draw_uniform(rng, FRICTION),
    )


def learn_damage(*, seed: int) -> DamageModel:
    """Press training objects in a test stand until they yield, and learn the damage limit.

    The label is the force at yield. The curves have the resolution and noise of the hand's
    readings: a model of clean curves would take the noise of a reading for a bend. Objects that
    withstand the largest force of the stand are skipped.
    """
    paths, limits_n = list[list[ClosingState]](), list[float]()
    rng = np.random.default_rng([seed, 34])
    while len(paths) < PRESSED:
        obj = draw_random_object(rng, size_mm=SIZES_MM["rigid"])
        if obj.yield_n < _PRESS_UP_TO_N:
            paths.append(_press(obj, rng=rng))
            limits_n.append(obj.yield_n)
    return fit_damage_model(paths, rupture_force_n=limits_n, kinds=["thing"] * len(paths))


def _press(obj: TwinObject, *, rng: np.random.Generator) -> list[ClosingState]:
    """Press an object until it yields; return the states with noisy forces."""
    curve, states = ClosingCurve(), list[ClosingState]()
    deformation_mm, force_n = 0.0, 0.0
    while force_n < obj.yield_n:
        read_n = force_n
        while force_n < min(read_n + _RISE_N, obj.yield_n):
            deformation_mm += _STEP_MM
            force_n = object_force_n(obj, deformation_mm, ruptured=False)[0]
        read_n = force_n * float(np.exp(_WOBBLE * rng.standard_normal()))
        if force_n > _FIRST_READING_N:
            states += curve.push(
                deformation_mm + _CLOSURE_SD_MM * rng.standard_normal(), force_n=read_n
            )
    return states


@dataclass(frozen=True, slots=True, kw_only=True)
class GripOutcome:
    """The outcome of one task; None for quantities that the method does not report.

    Attributes
    ----------
    method, outcome : str
        Method and outcome of the grasp.
    force_n : float
        True settled force of the final hold.
    reported_n, low_n, high_n : float or None
        Reported settled force and its interval.
    lifted, dropped, damaged, limited : bool
        Whether the object was lifted, fell and was pressed beyond its yield, and whether the damage
        limit kept the force below the target.
    on_target_s : float or None
        Time from contact to the first report of being on target after the last movement.
    """

    task: Task
    method: str
    outcome: str
    force_n: float
    lifted: bool
    dropped: bool
    damaged: bool
    reported_n: float | None = None
    low_n: float | None = None
    high_n: float | None = None
    limited: bool = False
    on_target_s: float | None = None

    @property
    def could_withstand(self) -> bool:
        """Whether the object withstands the target force with its tolerance."""
        return self.task.obj.yield_n > (1.0 + NEAR) * self.task.target_n

    @property
    def relative_error(self) -> float:
        """Relative error of the settled force."""
        return self.force_n / self.task.target_n - 1.0


def grip_as_shipped(task: Task, *, damage: DamageModel | None) -> GripOutcome:
    """Grip with the shipped controller; `damage=None` disables the damage limit."""
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
    result = require_uninterrupted(
        run_grasp(plan, array=array, gripper=gripper, clock=world.clock, watchers=[arm])
    )
    force, truth = result.force_n, world.truth()
    return GripOutcome(
        task=task,
        method=UNLIMITED if damage is None else "ours",
        outcome=str(result.outcome),
        lifted=bool(lifted),
        dropped=world.has_dropped,
        reported_n=None if force is None else force.value,
        low_n=None if force is None else force.low,
        high_n=None if force is None else force.high,
        limited=result.is_limited,
        on_target_s=_on_target_s(result),
        force_n=truth.force_n,
        damaged=is_damaged(world, task),
    )


def is_damaged(world: World, task: Task) -> bool:
    """Return whether the object was pressed beyond its yield."""
    return world.truth().peak_force_n >= task.obj.yield_n


def _on_target_s(result: GraspResult) -> float | None:
    """Return the time from contact to the last report of being on target."""
    at = {moment.name: moment.time_s for moment in result.moments if moment.finger is None}
    if "contact" not in at or at.get("on_target", -1.0) < at.get("adjusted", -1.0):
        return None
    return at["on_target"] - at["contact"] if "on_target" in at else None


@lru_cache(maxsize=2)
def calibration_of(sheet: int, level: str, kind: GripperKind) -> Calibration:
    """Calibrate a sensor and gripper with a user's steps, once per sheet."""
    return calibrate_twin(seed=sheet, level=level, apart_from="", kind=kind)
