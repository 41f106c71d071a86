"""Run one grasp on the twin with a single fault in one phase."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np

from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.twin.devices import TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import GripperKind, World
from palpate_studies.fault_devices import FAULTS, FaultyArray, FaultyGripper, inject_fault

KINDS: tuple[GripperKind, ...] = ("rigid", "soft")
OBJECTS = ("rigid-block", "ball-44lbs", "strawberry")
#: Phase of the fault -> the controller's activities in this phase.
PHASE_ACTIVITIES = {
    "start": (Activity.TOUCH,),
    "approach": (Activity.SWEEP,),
    "squeeze": (Activity.CONFIRM, Phase.SQUEEZE),
    "hold": (Activity.FORECAST, Activity.ADJUST, Activity.EASE, Phase.HOLD),
}
#: Phase of a fault in the middle of a movement -> the activities of these movements.
MOVING_ACTIVITIES = {
    "closing": (Phase.SQUEEZE,),
    "correcting": (Activity.FORECAST, Activity.EASE),
}
#: Frames/s: of the paper's sensor, and of the product.
RATES_HZ = (15.0, 250.0)
#: Step speeds relative to the plan's; the approach computes its own speed.
SPEEDS = (0.5, 1.0, 2.0)
#: Seed of sheet and gripper.
SHEET = 7300
_TARGET_N = 4.0
#: Initial gap to the object, mm, and observation time after the end of the grasp, seconds.
_GAP_MM, _OBSERVED_AFTER_S = 8.0, 2.0
_LONGEST_S = 40.0
#: In the approach, the fault occurs this long after the hand reached its speed, seconds.
_AT_SPEED_S = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One grasp of the campaign."""

    fault: str
    phase: str
    thing: str
    kind: GripperKind
    speed: float
    rate_hz: float = 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultyGrasp:
    """The outcome of one grasp with a fault.

    Attributes
    ----------
    cell : Cell
        The grasp.
    struck : bool
        Whether the grasp reached the phase, so that the fault occurred.
    outcome : str
        Outcome of the grasp.
    reason : str
        First line of the explanation; empty without one.
    peak_n, stays_n : float
        True grip force: the maximum, and the remainder some time after the end.
    damaged : bool
        Whether the object was damaged.
    safe_s : float
        Time from the fault to the last command; NaN if the fault did not occur.
    """

    cell: Cell
    struck: bool
    outcome: str
    reason: str
    peak_n: float
    stays_n: float
    damaged: bool
    safe_s: float


def list_cells(*, rates_hz: Sequence[float] = RATES_HZ) -> list[Cell]:
    """Return all cells of the campaign; soft fingers have no faults of the servo current."""
    found = [
        Cell(fault=fault, phase=phase, thing=thing, kind=kind, speed=speed, rate_hz=rate_hz)
        for fault, phase, thing, kind, speed, rate_hz in product(
            FAULTS, (*PHASE_ACTIVITIES, *MOVING_ACTIVITIES), OBJECTS, KINDS, SPEEDS, rates_hz
        )
    ]
    return [cell for cell in found if not (cell.kind == "soft" and "current" in cell.fault)]


def sample_cells(cells: Sequence[Cell], count: int, *, seed: int) -> list[Cell]:
    """Return a sample of cells in which all faults are about equally frequent."""
    rng = np.random.default_rng(seed)
    by_fault = {name: [cell for cell in cells if cell.fault == name] for name in FAULTS}
    each = [rng.permutation(len(found)).tolist() for found in by_fault.values()]
    rounds = [
        found[order[turn]]
        for turn in range(max(map(len, each)))
        for found, order in zip(by_fault.values(), each, strict=True)
        if turn < len(order)
    ]
    return rounds[:count]


@cache
def _plan(kind: GripperKind) -> Plan:
    calibration = calibrate_twin(seed=SHEET, level="lab", apart_from="", kind=kind)
    gripper = TwinGripper(World(None, seed=SHEET, gripper=kind))
    return plan_grasp(
        calibration, gripper=gripper, target_force_n=_TARGET_N, longest_s=_LONGEST_S, hold_s=1.5
    )


def _is_due(cell: Cell, state: GraspState, movement_s: float) -> bool:
    """Return whether the fault strikes after this frame.

    `movement_s`: duration of the last movement. One shorter than a frame period is struck at once.
    """
    estimate, activities = state.estimate, PHASE_ACTIVITIES | MOVING_ACTIVITIES
    if state.activity not in activities[cell.phase]:
        return False
    if cell.phase == "approach":
        return bool(estimate.sweep and estimate.now_s - estimate.sweep.since_s > _AT_SPEED_S)
    if cell.phase not in MOVING_ACTIVITIES:
        return True
    wait_s = 0.5 * movement_s if movement_s * cell.rate_hz > 1.0 else 0.0
    is_moving = estimate.still_since_s is None and estimate.contact_s is not None
    return is_moving and estimate.now_s - estimate.moved_s >= wait_s


def run_faulty_grasp(cell: Cell, *, seed: int) -> FaultyGrasp:
    """Run one grasp and inject the fault in its phase."""
    plan = _plan(cell.kind)
    plan = replace(plan, rate=cell.speed * plan.rate, squeeze_rate=cell.speed * plan.squeeze_rate)
    obj = draw_object(np.random.default_rng([seed, 1]), cell.thing)
    world = World(obj, seed=seed, sheet_seed=SHEET, gripper=cell.kind, frame_rate_hz=cell.rate_hz)
    if cell.kind == "rigid":
        world.drive(obj.size_mm + _GAP_MM, rate=60.0)
    world.clock.sleep_s(1.0)
    array, gripper, requests = FaultyArray(world), FaultyGripper(world), Requests()
    fault, struck_s = FAULTS[cell.fault](), list[float]()

    def strike() -> None:
        struck_s.append(world.clock.now_s())
        inject_fault(fault, world=world, array=array, gripper=gripper, requests=requests)

    def watch(grasp_state: GraspState) -> None:
        if not struck_s and _is_due(cell, grasp_state, gripper.movement_s):
            strike()

    if cell.phase == "start":
        strike()
    result = run_grasp(
        plan, array=array, gripper=gripper, clock=world.clock, watchers=[watch], requests=requests
    )
    ended_s = world.clock.now_s()
    world.clock.sleep_s(_OBSERVED_AFTER_S)
    stays_n = world.force_n(world.clock.now_s())
    truth = world.truth()
    return FaultyGrasp(
        cell=cell,
        struck=bool(struck_s),
        outcome=str(result.outcome),
        reason=result.faults[0] if result.faults else "",
        peak_n=truth.peak_force_n,
        stays_n=stays_n,
        damaged=truth.damaged,
        safe_s=ended_s - struck_s[0] if struck_s else math.nan,
    )
