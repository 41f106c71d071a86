"""Pull held simulated fruit, and compare the verdict "secure to pull" with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Annotated, Any

import numpy as np
import typer

from palpate.grasp.planning import plan_grasp
from palpate.grasp.pull import judge_pull
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.measurement import Measurement
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.friction import N_PER_G
from palpate.twin.objects import draw_object
from palpate.twin.world import World
from palpate_studies.force_control_world import GRASPS_PER_SHEET, calibration_of
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS

FRUIT = ("strawberry", "tomato", "apple", "kiwi")
PULLS_N = tuple(float(pull_n) for pull_n in range(1, 11))
#: Seed of the first fruit, not used before, and range of the target forces, newtons.
FIRST_SEED, TARGETS_N = 7_600_000, (2.0, 10.0)
#: Duration of a pull, seconds.
_PULLED_S = 3.0
VERDICTS = ("secure to pull", "not sure", "would slip")


def report(
    *, fruits: Annotated[int, typer.Option(help="Fruit of each level.", min=1)] = 40
) -> StudyReport:
    """Grip fruit, judge pulls of 1 to 10 N with the known friction, and pull.

    Example: palpate study harvest --fruits 100 --out reports
    """
    seeds = range(FIRST_SEED, FIRST_SEED + fruits)
    return judge(
        [row for level in LEVELS for seed in seeds for row in judge_pulls(seed, level=level)]
    )


command = as_command(report)


def judge_pulls(seed: int, *, level: str) -> list[dict[str, Any]]:
    """Grip one fruit; judge and simulate ten pulls from the state at the answer."""
    rng = np.random.default_rng([seed, 51])
    name = FRUIT[seed % len(FRUIT)]
    sheet = seed // GRASPS_PER_SHEET
    obj = draw_object(rng, name)
    world = World(obj, seed=seed, sheet_seed=sheet, level=level)
    gripper = TwinGripper(world)
    plan = plan_grasp(
        calibration_of(sheet, level, "rigid"),
        gripper=gripper,
        target_force_n=float(rng.uniform(*TARGETS_N)),
        hold_s=0.5,
    )
    held = list[tuple[World, Measurement]]()

    def watch(grasp_state: GraspState) -> None:
        answered = grasp_state.result.force_n
        is_answer = any(moment.name == "answer" for moment in grasp_state.result.moments)
        if is_answer and answered is not None and not held:
            held.append((deepcopy(world), answered))

    run_grasp(plan, array=TwinArray(world), gripper=gripper, clock=world.clock, watchers=[watch])
    weight_n = N_PER_G * obj.mass_g
    found = []
    for pull_n in PULLS_N if held else ():
        copy, force = deepcopy(held[0])
        verdict = judge_pull(force, pull_n=pull_n, friction=obj.friction).verdict
        copy.lift(more_n=pull_n - weight_n)
        copy.clock.sleep_s(_PULLED_S)
        copy.force_n(copy.clock.now_s())
        found.append(
            {
                "level": level,
                "fruit": name,
                "seed": seed,
                "pull_n": pull_n,
                "verdict": verdict,
                "slipped": copy.has_dropped,
            }
        )
    return found


def judge(rows: Sequence[dict[str, Any]]) -> StudyReport:
    """Return the report of any number of pulls."""
    summary = [
        {
            "level": level,
            "fruits": len({row["seed"] for row in rows if row["level"] == level}),
            "verdict": verdict,
            "pulls": len(part),
            "slipped": sum(row["slipped"] for row in part),
        }
        for level in LEVELS
        for verdict in VERDICTS
        for part in [[r for r in rows if (r["level"], r["verdict"]) == (level, verdict)]]
    ]
    return StudyReport(
        name="harvest",
        title="Pulls of 1 to 10 N on held fruit (simulated)",
        provenance=[
            f"Simulated: {', '.join(FRUIT)} in turn, four per sensor, gripped with rigid fingers "
            f"to a random {TARGETS_N[0]:g} to {TARGETS_N[1]:g} N. From the state at the answer "
            f"each fruit is pulled for {_PULLED_S:g} s; the pull includes the weight. The "
            "friction is known.",
        ],
        tables=[Table.of("Verdicts and slips", summary)],
        payload={
            "simulated": True,
            "summary": summary,
            "rows": list(rows),
        },
    )
