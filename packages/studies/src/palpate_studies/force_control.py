"""Grip random simulated objects to a force and lift them, with palpate and with baselines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate_studies.baselines.feedback_loops import (
    LOOPS,
    Laws,
    learn_laws,
    run_learned_loop,
    run_paper_loop,
)
from palpate_studies.force_control_world import (
    GRASPS_PER_SHEET,
    NEAR,
    PRESSED,
    TARGETS_N,
    UNLIMITED,
    GripOutcome,
    Task,
    draw_task,
    grip_as_shipped,
    learn_damage,
)
from palpate_studies.protocol.paired import compare
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, group, mean, median

if TYPE_CHECKING:
    from palpate.object.damage import DamageModel

#: First seed of the reported grasps, fixed before anything was scored on them.
FIRST_SEED = 870_000
#: First seed and number of training tasks; they are not reported.
LEARNING_SEED, LEARNED_FROM = 1_600_000, 240


def report(
    *,
    grasps: Annotated[int, typer.Option(help="Objects gripped at each level.", min=1)] = 8,
) -> StudyReport:
    """Grip random objects to a force and lift them; count misses, drops and damage.

    Example: palpate study force-control --grasps 100 --out reports
    """
    found = list[GripOutcome]()
    damage = learn_damage(seed=FIRST_SEED)
    for level in LEVELS:
        tasks = [draw_task(seed, level=level) for seed in range(FIRST_SEED, FIRST_SEED + grasps)]
        training = range(LEARNING_SEED, LEARNING_SEED + LEARNED_FROM)
        laws = learn_laws([draw_task(seed, level=level) for seed in training])
        found += grip_all(tasks, damage=damage, laws=laws)
    return judge(found)


command = as_command(report)


def grip_all(tasks: Sequence[Task], *, damage: DamageModel, laws: Laws) -> Iterator[GripOutcome]:
    """Grip every task with and without the damage limit, and with each baseline."""
    for one in tasks:
        yield grip_as_shipped(one, damage=damage)
        yield grip_as_shipped(one, damage=None)
        yield run_paper_loop(one)
        yield from (run_learned_loop(one, learner, laws=laws) for learner in LOOPS)


def scores(found: Sequence[GripOutcome]) -> dict[str, Any]:
    """Return the scores of the grasps of one method at one level."""
    count = len(found)
    lifted = [one for one in found if one.lifted]
    # Grasps that the damage limit kept below the target are not misses.
    aimed = [one for one in found if not one.limited and (one.reported_n is not None or one.lifted)]
    near = [abs(one.relative_error) <= NEAR for one in aimed]
    near_of_all = [abs(one.relative_error) <= NEAR for one in found]
    covered = [
        one.low_n <= one.force_n <= one.high_n
        for one in found
        if one.low_n is not None and one.high_n is not None
    ]
    times_s = [one.on_target_s for one in found if one.on_target_s is not None]
    return {
        "grasps": count,
        "damaged": sum(one.damaged for one in found),
        "lifted": len(lifted),
        "dropped": sum(one.dropped for one in lifted),
        "not_lifted": count - len(lifted),
        "limited": sum(one.limited for one in found),
        "limited_could_bear": sum(one.limited and one.could_withstand for one in found),
        "could_bear": sum(one.could_withstand for one in found),
        "aimed": len(aimed),
        # Over all objects, and over the objects that the method gripped to the target.
        "within_10_percent_of_all": float(np.mean(near_of_all)),
        "within_10_percent": mean(near),
        "median_off_target_percent": median([100 * abs(one.relative_error) for one in aimed]),
        "coverage": mean(covered),
        "median_on_target_s": median(times_s),
    }


def compare_methods(found: Sequence[GripOutcome], *, method: str = "ours") -> list[dict[str, Any]]:
    """Compare a method of palpate with every baseline on objects gripped by both, by sensor.

    The loss of an object is 1 if its settled force is not within 10 % of the target, for any
    reason.
    """
    rows = []
    for key, mine in group(found, "task.level"):
        lost = {
            name["method"]: {one.task.seed: float(abs(one.relative_error) > NEAR) for one in each}
            for name, each in group(mine, "method")
        }
        ours = lost.pop(method, {})
        for baseline, theirs in lost.items():
            both = [seed for seed in theirs if seed in ours]
            if not both or baseline in ("ours", UNLIMITED):
                continue
            pair = {
                method: [ours[seed] for seed in both],
                baseline: [theirs[seed] for seed in both],
            }
            sensors = [str(seed // GRASPS_PER_SHEET) for seed in both]
            near = [1 - float(np.mean(each)) for each in pair.values()]
            rows += compare(
                pair,
                sensors,
                ours=method,
                statistic=np.mean,
                **key,
                method=method,
                ours_near=near[0],
                rival_near=near[1],
            )
    return rows


def judge(found: Sequence[GripOutcome]) -> StudyReport:
    """Return the report of any number of grasps."""
    summary = [
        {**key, "gripper": "all", **scores(part)}
        for key, part in group(found, "task.level", "method")
    ]
    return StudyReport(
        name="force-control",
        title="Gripping random objects to a force, and lifting them (simulated)",
        provenance=(
            "Simulated: sizes within the stroke, stiffness over two decades, linear or Hertz "
            "contact, flat or round, half of them relaxing like fruit, off-centre, on worn sheets; "
            f"every fourth sensor on soft fingers. Targets: {TARGETS_N[0]:g} to {TARGETS_N[1]:g} "
            "N. At the lowest friction, lifting the weight requires 20-60 % of the target.",
            f"Each sensor is calibrated with a user's steps and makes {GRASPS_PER_SHEET} grasps. "
            f"The damage limit is learned from {PRESSED} other objects pressed in a test stand; "
            "the kind of the object is not given.",
            "Within 10 %: true settled force relative to the target, without the grasps that the "
            "damage limit kept below it.",
            "Lifted: palpate lifts only if it reports that the grip suffices; the baselines always "
            "lift.",
            "The paper's line: the line of its Table 4, fitted to the settled pairs of the same "
            "calibration, with equations 2 and 3 as feedback in both directions.",
            "Learners: the same loop as the paper's line. The feedback is palpate's calibrated "
            "law, corrected with all readings of the first 2.5 s, the closure and the servo "
            f"current; trained for each level on {LEARNED_FROM} other objects on other sensors "
            f"(seeds from {LEARNING_SEED} on).",
        ),
        tables=[Table.of(title, summary, [*_LEAD, *keys]) for title, keys in _TABLES.items()],
        payload={
            "simulated": True,
            "summary": summary,
            "compared": [*compare_methods(found), *compare_methods(found, method=UNLIMITED)],
        },
    )


_LEAD = ("level", "method")
#: Title -> keys of the summary; one table with all columns would be too wide for a screen.
_TABLES = {
    "Outcome": ("grasps", "damaged", "lifted", "dropped", "limited", "limited_could_bear"),
    "Accuracy relative to the target": (
        "within_10_percent_of_all",
        "aimed",
        "within_10_percent",
        "median_off_target_percent",
        "coverage",
        "median_on_target_s",
    ),
}
