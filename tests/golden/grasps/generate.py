"""Seeded grasps on the twin and what came of each; writes grasps.json, which freezes it.

Run from the top of the tree: ``PYTHONPATH=. python tests/golden/grasps/generate.py``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from palpate.estimate.damage import DamageModel
from palpate.estimate.measurement import Measurement
from palpate.estimate.strength import Strength
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import use_paper_method
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.runner import run_grasp
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import Calibration
from palpate.twin.objects import OBJECTS, draw_object
from palpate.twin.world import GripperKind, World
from palpate_studies.fault_devices import FAULTS, FaultyArray, FaultyGripper

KEPT = Path(__file__).with_name("grasps.json")
#: Sensors of each level; every one is calibrated once.
SHEETS = (8100, 8101)
#: When a fault strikes, seconds from the start or from the first true touch of this many newtons.
STRUCK_S = {"start": 0.0, "approach": 0.6, "squeeze": 0.05, "settle": 2.0}
TOUCH_N = 0.3
DAMAGE = DamageModel(
    strengths={
        "": Strength(
            log_stiffness=0.7,
            stiffness_log_sd=0.6,
            log_force=1.9,
            slope=0.8,
            log_sd=0.25,
            objects=60,
        )
    },
    low_fractions={"": 0.6},
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One grasp.

    `plan`: options of `plan_grasp`.
    `without`: what its calibration or plan lacks.
    """

    name: str
    kind: GripperKind
    level: str
    seed: int
    thing: str | None
    plan: dict[str, Any]
    fault: str = "none"
    struck: str = "start"
    rate_hz: float = 15.0
    paper: Paper | None = None
    without: str = ""


def cases() -> list[Case]:
    """Return all cases."""
    return [*_healthy(), *_faulty()]


def _healthy() -> Iterator[Case]:
    rng = np.random.default_rng(41)
    things = cycle(rng.permutation(list(OBJECTS)).tolist())
    rigs = cycle([("rigid", "lab"), ("rigid", "field"), ("soft", "lab"), ("soft", "field")])
    rows: list[tuple[str, int, Callable[[str], dict[str, Any]]]] = [
        ("gentle", 28, lambda kind: {}),
        ("to a force", 28, lambda kind: {"target_force_n": float(rng.choice([1, 2, 4, 8]))}),
        ("lift", 8, lambda kind: {"lift_force_n": float(rng.uniform(1.0, 5.0))}),
        ("lift to a force", 4, lambda kind: {"lift_force_n": 2.0, "target_force_n": 4.0}),
        ("expected size", 8, lambda kind: {"expect_size_mm": float(rng.uniform(45.0, 70.0))}),
        ("damage limit", 8, lambda kind: {"damage": DAMAGE}),
        ("damage limit to a force", 6, lambda kind: {"damage": DAMAGE, "target_force_n": 5.0}),
    ]
    seed = 100
    for name, count, options in rows:
        for number in range(count):
            kind, level = next(rigs)
            seed += 1
            yield Case(
                name=f"{name} {number}",
                kind=kind,  # type: ignore[arg-type]
                level=level,
                seed=seed,
                thing=next(things),
                plan=options(kind),
            )
    plain = Case(name="", kind="rigid", level="lab", seed=0, thing="ball-44lbs", plan={})
    soft = replace(plain, kind="soft", level="field")
    for number, other in enumerate(
        [
            replace(plain, name="nothing there", thing=None),
            replace(soft, name="nothing there, soft", thing=None),
            replace(plain, name="two tries", thing=None, plan={"tries": 2}),
            replace(plain, name="250 frames/s", rate_hz=250.0),
            replace(soft, name="250 frames/s, soft", rate_hz=250.0, thing="apple"),
            replace(plain, name="60 frames/s", rate_hz=60.0, level="field", thing="kiwi"),
            replace(plain, name="5 frames/s", rate_hz=5.0, thing="tomato"),
            replace(plain, name="no current law", without="current"),
            replace(
                plain, name="no current law, 3 N", without="current", plan={"target_force_n": 3.0}
            ),
            replace(plain, name="no pixels", without="pixel_excess"),
            replace(
                plain, name="no pixels, 3 N", without="pixel_excess", plan={"target_force_n": 3.0}
            ),
            replace(soft, name="one block", without="bend", thing="banana"),
            replace(plain, name="paper", paper=Paper(extra_mm=1.0)),
            replace(plain, name="paper, field", paper=Paper(), level="field", thing="kiwi"),
            replace(soft, name="paper, soft", paper=Paper(), thing="ball-33lbs"),
            replace(plain, name="too long", plan={"longest_s": 3.0}),
        ]
    ):
        yield replace(other, seed=300 + number)


def _faulty() -> Iterator[Case]:
    rng = np.random.default_rng(42)
    things = cycle(["rigid-block", "ball-44lbs", "strawberry"])
    moments = cycle(STRUCK_S)
    for number, fault in enumerate([name for name in FAULTS if name != "none"]):
        for turn in range(2):
            kind: GripperKind = "soft" if turn and "current" not in fault else "rigid"
            struck = next(moments)
            yield Case(
                name=f"{fault}, {struck}, {kind}",
                kind=kind,
                level=str(rng.choice(["lab", "field"])),
                seed=500 + 2 * number + turn,
                thing=next(things),
                plan={"target_force_n": 4.0, "longest_s": 40.0, "hold_s": 1.5},
                fault=fault,
                struck=struck,
            )
        next(moments)


@cache
def calibration(kind: GripperKind, level: str, sheet: int) -> Calibration:
    """Return the calibration of a sensor."""
    return calibrate_twin(seed=sheet, level=level, apart_from="", kind=kind)


def run(case: Case) -> dict[str, Any]:
    """Make one grasp and summarize it."""
    sheet = SHEETS[case.seed % len(SHEETS)]
    thing = case.thing and draw_object(np.random.default_rng([case.seed, 1]), case.thing)
    world = World(
        thing or None,
        seed=case.seed,
        sheet_seed=sheet,
        level=case.level,
        gripper=case.kind,
        frame_rate_hz=case.rate_hz,
    )
    array, gripper, requests = FaultyArray(world), FaultyGripper(world), Requests()
    known = calibration(case.kind, case.level, sheet)
    if case.without == "current":
        known = replace(known, current=None)
    if case.without == "pixel_excess":
        known = replace(known, force=replace(known.force, pixel_excess=()))
    plan = plan_grasp(known, gripper=gripper, **case.plan)
    if case.without == "bend":
        plan = replace(plan, bend=None)
    if case.paper is not None:
        plan = use_paper_method(plan, case.paper, calibration=known)
    strike = _Strike(case, world=world, array=array, gripper=gripper, requests=requests)
    strike(None)
    result = run_grasp(
        plan,
        array=array,
        gripper=gripper,
        clock=world.clock,
        subscribers=[strike],
        requests=requests,
    )
    truth = world.truth()
    return {
        "outcome": str(result.outcome),
        "decision_s": result.decision_time_s,
        "size_mm": _ends(result.size_mm),
        "force_n": _ends(result.force_n),
        "stiffness": _ends(result.stiffness_n_per_mm),
        "settled_percent": _ends(result.settled_percent),
        "width_mm": _short(result.previous_width_mm),
        "peak_n": _short(result.peak_force_n),
        "true_peak_n": _short(truth.peak_force_n),
        "damaged": truth.damaged,
        "frames": result.frames,
        "moments": " ".join(f"{moment.name}@{moment.time_s:.2f}" for moment in result.moments),
        "faults": list(result.faults),
    }


class _Strike:
    """A view that sets a fault once it is time."""

    def __init__(
        self,
        case: Case,
        *,
        world: World,
        array: FaultyArray,
        gripper: FaultyGripper,
        requests: Requests,
    ) -> None:
        self._case, self._world, self._requests = case, world, requests
        self._devices = (array, gripper)
        self._done = case.fault == "none"
        self._from_s = 0.0 if case.struck in ("start", "approach") else None

    def __call__(self, _: object) -> None:
        world, now_s = self._world, self._world.clock.now_s()
        if self._from_s is None and world.force_n(now_s) > TOUCH_N:
            self._from_s = now_s
        if self._done or self._from_s is None:
            return
        if now_s < self._from_s + STRUCK_S[self._case.struck]:
            return
        self._done, fault = True, FAULTS[self._case.fault]()
        for device in self._devices:
            device.fault = fault
        world.clock.sleep_s(fault.hang_s)
        if fault.pushed_mm and self._case.kind == "rigid":
            self._devices[1].state()
            now_mm = world.drive_value(world.clock.now_s())
            world.drive(now_mm - fault.pushed_mm, rate=60.0)
        if fault.user_stops:
            self._requests.stop.set()


def _ends(one: Measurement | None) -> list[Any] | None:
    if one is None:
        return None
    return [_short(one.value), _short(one.low), _short(one.high), str(one.status)]


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def main() -> None:
    """Write the summaries of all cases."""
    rows = [f"{json.dumps(case.name)}: {json.dumps(run(case))}" for case in cases()]
    KEPT.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main()
