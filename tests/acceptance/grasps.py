"""Seeded grasps on the twin: what is grasped, and how; and running one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import count, cycle, pairwise
from typing import Any

import numpy as np

from palpate.calibration import Calibration
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.object.damage import DamageModel
from palpate.twin.objects import Truth, TwinObject
from palpate.twin.ranges import draw_log_uniform
from palpate.twin.velostat import Environment
from palpate.twin.world import GripperKind, World
from palpate_studies.fault_devices import FAULTS, FaultyArray, FaultyGripper, inject_fault
from palpate_studies.fault_grasps import PHASE_ACTIVITIES
from palpate_studies.force_control_world import (
    SIZES_MM,
    TARGETS_N,
    calibration_of,
    draw_random_object,
    learn_damage,
)

#: Grasps with one sensor, and sensors; a calibration costs as much as four grasps.
GRASPS_PER_SHEET, SHEETS = 10, 40
FIRST_SHEET = 8200
#: Kind of gripper and scatter of the twin, of each sensor in turn.
RIGS: tuple[tuple[GripperKind, str], ...] = (
    ("rigid", "lab"),
    ("rigid", "field"),
    ("soft", "lab"),
    ("soft", "field"),
)
GENTLE, TO_FORCE, LIMIT, FAULT = "gentle", "to a force", "damage limit", "fault"
LIMIT_TO_FORCE, EXPECTED, LIFT = "damage limit to a force", "expected size", "lift"
FAST_GENTLE, FAST_TO_FORCE = "gentle, 250 frames/s", "to a force, 250 frames/s"
#: Tasks of one sensor; a special one in place of None.
_TASKS = (
    *(GENTLE, TO_FORCE, GENTLE, LIMIT, TO_FORCE),
    *(None, LIMIT_TO_FORCE, GENTLE, TO_FORCE, FAULT),
)
_SPECIAL = (FAST_GENTLE, FAST_TO_FORCE, EXPECTED, LIFT)
#: An object that is gripped to a force without a damage limit withstands this multiple of it.
_WITHSTANDS = 1.3
#: Lift force relative to the target; error of an expected size, mm; wear since the calibration.
_LIFT_FRACTION, _SIZE_ERROR_MM, _MOST_CYCLES = 0.5, 3.0, 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One grasp.

    `obj`: None without an object. `options`: those of `plan_grasp`. `fault`: a name in `FAULTS`,
    which strikes in a phase (`PHASE_ACTIVITIES`). `cycles`: wear of the sheet.
    """

    task: str
    seed: int
    sheet: int
    kind: GripperKind
    level: str
    obj: TwinObject | None
    options: dict[str, Any] = field(default_factory=dict)
    fault: str = "none"
    phase: str = "start"
    rate_hz: float = 15.0
    cycles: int = 0

    @property
    def calibration(self) -> Calibration:
        """Calibration of its sensor and gripper."""
        return calibration_of(self.sheet, self.level, self.kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What came of a case.

    `touch_s`: from the start to the contact. `touch_peak_n`: largest true force until then.
    `rise_n`: largest rise of the true force from one closing step to the next.
    `answer_s`: from the contact to the answer. Each is NaN without one.
    """

    case: Case
    result: GraspResult
    truth: Truth
    touch_s: float
    touch_peak_n: float
    rise_n: float
    answer_s: float


def list_cases(grasps: int = GRASPS_PER_SHEET * SHEETS) -> list[Case]:
    """Return the first cases, those of one sensor next to each other."""
    faults = _faults()
    return [
        case
        for number in range(-(-grasps // GRASPS_PER_SHEET))
        for case in _cases_of(number, *next(faults))
    ][:grasps]


def _faults() -> Iterator[tuple[str, str]]:
    """Yield a fault and its phase for each sensor; soft fingers report no current."""
    names = np.random.default_rng(51).permutation([name for name in FAULTS if name != "none"])
    with_current = cycle(names.tolist())
    without = cycle([name for name in names.tolist() if "current" not in name])
    phases = list(PHASE_ACTIVITIES)
    for number in count():
        kind, _ = RIGS[number % len(RIGS)]
        phase = phases[(number + number // len(RIGS)) % len(phases)]
        yield next(with_current if kind == "rigid" else without), phase


def _cases_of(number: int, fault: str, phase: str) -> list[Case]:
    """Return the cases of one sensor."""
    kind, level = RIGS[number % len(RIGS)]
    special = _SPECIAL[(number + number // len(RIGS)) % len(_SPECIAL)]
    found = []
    for turn, task in enumerate(one or special for one in _TASKS):
        seed = GRASPS_PER_SHEET * (FIRST_SHEET + number) + turn
        rng = np.random.default_rng([seed, 51])
        is_gentle = task in (GENTLE, FAST_GENTLE, LIMIT, EXPECTED)
        target_n = None if is_gentle else draw_log_uniform(rng, TARGETS_N)
        obj = draw_random_object(rng, size_mm=SIZES_MM[kind])
        # Without a limit, damage at the target is the user's wish and not a fault.
        while target_n and task != LIMIT_TO_FORCE and obj.yield_n < _WITHSTANDS * target_n:
            obj = draw_random_object(rng, size_mm=SIZES_MM[kind])
        options: dict[str, Any] = {"target_force_n": target_n}
        if task in (LIMIT, LIMIT_TO_FORCE):
            options["damage"] = damage_model()
        if task == EXPECTED:
            options["expect_size_mm"] = obj.size_mm + rng.uniform(-_SIZE_ERROR_MM, _SIZE_ERROR_MM)
        if task == LIFT and target_n:
            options["lift_force_n"] = _LIFT_FRACTION * target_n
        found.append(
            Case(
                task=task,
                seed=seed,
                sheet=FIRST_SHEET + number,
                kind=kind,
                level=level,
                obj=obj,
                options=options,
                fault=fault if task == FAULT else "none",
                phase=phase,
                rate_hz=250.0 if task in (FAST_GENTLE, FAST_TO_FORCE) else 15.0,
                cycles=int(rng.integers(_MOST_CYCLES)),
            )
        )
    return found


@cache
def damage_model() -> DamageModel:
    """Return a damage limit learned from other objects."""
    return learn_damage(seed=FIRST_SHEET)


def run_case(
    case: Case,
    *,
    calibration: Calibration | None = None,
    revise: Callable[[Plan], Plan] = lambda plan: plan,
) -> Run:
    """Make one grasp.

    `calibration`: in place of the sensor's own. `revise`: changes the plan.
    """
    world = World(
        case.obj,
        seed=case.seed,
        sheet_seed=case.sheet,
        level=case.level,
        gripper=case.kind,
        frame_rate_hz=case.rate_hz,
        environment=Environment(cycles=case.cycles),
    )
    array, gripper, requests = FaultyArray(world), FaultyGripper(world), Requests()
    plan = revise(plan_grasp(calibration or case.calibration, gripper=gripper, **case.options))
    seen, is_sound = dict[str, tuple[float, float]](), case.fault == "none"
    forces_n = dict[int, float]()
    started_s = world.clock.now_s()

    def strike() -> None:
        nonlocal is_sound
        is_sound = True
        inject_fault(
            FAULTS[case.fault](), world=world, array=array, gripper=gripper, requests=requests
        )

    def watch(state: GraspState) -> None:
        for moment in state.result.moments:
            if moment.finger is None and moment.name not in seen:
                peak_n = world.truth().peak_force_n if moment.name == "contact" else np.nan
                seen[moment.name] = state.estimate.now_s - started_s, peak_n
        if len(state.estimate.steps) not in forces_n:
            forces_n[len(state.estimate.steps)] = world.force_n(world.clock.now_s())
        if not is_sound and state.activity in PHASE_ACTIVITIES[case.phase]:
            strike()

    if not is_sound and case.phase == "start":
        strike()
    result = run_grasp(
        plan, array=array, gripper=gripper, clock=world.clock, watchers=[watch], requests=requests
    )
    if result.outcome is Outcome.STOPPED and not FAULTS[case.fault]().user_stops:
        # Ctrl-C ends a grasp safely, and should end the whole report.
        raise KeyboardInterrupt
    # Nothing is compared with the force without a step, 0.
    steps_n = [force_n for number, force_n in sorted(forces_n.items()) if number]
    touch_s, touch_peak_n = seen.get("contact", (np.nan, np.nan))
    return Run(
        case=case,
        result=result,
        truth=world.truth(),
        touch_s=touch_s,
        touch_peak_n=touch_peak_n,
        rise_n=max((after - before for before, after in pairwise(steps_n)), default=np.nan),
        answer_s=seen.get("answer", (np.nan,))[0] - touch_s,
    )
