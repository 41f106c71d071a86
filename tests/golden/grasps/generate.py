"""A few seeded grasps on the twin and what came of each; writes grasps.json, which freezes it.

They catch accidents: a change that was not meant to change a grasp. After an intended change of
tuning, look at `make acceptance`, then write them again. Run from the top of the tree:
``PYTHONPATH=. python tests/golden/grasps/generate.py``.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tests.acceptance.grasps import Case, damage_model, run_case

from palpate.calibration import Calibration
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import use_paper_method
from palpate.grasp.plan import Plan
from palpate.measurement import Measurement
from palpate.twin.objects import draw_object
from palpate.twin.world import GripperKind

KEPT = Path(__file__).with_name("grasps.json")
#: The one sensor of each gripper, which is calibrated once.
_SHEET, _LEVELS = 8100, {"rigid": "lab", "soft": "field"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Golden:
    """A frozen grasp, with changes of the calibration and the plan that are no options."""

    case: Case
    strip: Callable[[Calibration], Calibration] = lambda known: known
    revise: Callable[[Plan, Calibration], Plan] = lambda plan, known: plan


def goldens() -> dict[str, Golden]:
    """Return the grasps by name."""
    rigid, soft = partial(_golden, "rigid"), partial(_golden, "soft")
    found = {
        "gentle": rigid("ball-44lbs"),
        "gentle, soft": soft("tomato"),
        "to a force": rigid("avocado-day-3", options={"target_force_n": 4.0}),
        "to a force, soft": soft("springs-4", options={"target_force_n": 3.0}),
        "lift": rigid("mango", options={"lift_force_n": 2.5}),
        "lift to a force, soft": soft(
            "avocado-day-2", options={"lift_force_n": 2.0, "target_force_n": 4.0}
        ),
        "expected size": rigid("kiwi", options={"expect_size_mm": 52.0}),
        "damage limit": rigid("strawberry", options={"damage": damage_model()}),
        "damage limit to a force, soft": soft(
            "banana", options={"damage": damage_model(), "target_force_n": 5.0}
        ),
        "two tries, nothing there": rigid(None, options={"tries": 2}),
        "250 frames/s": rigid("dragonskin-10", rate_hz=250.0),
        "no current law, 3 N": replace(
            rigid("ball-44lbs", options={"target_force_n": 3.0}),
            strip=lambda known: replace(known, current=None),
        ),
        "no pixels, 3 N": replace(
            rigid("ball-44lbs", options={"target_force_n": 3.0}),
            strip=lambda known: replace(known, force=replace(known.force, pixel_excess=())),
        ),
        "one block, soft": replace(
            soft("ball-33lbs"), revise=lambda plan, known: replace(plan, bend=None)
        ),
        "paper": replace(
            rigid("ball-44lbs"),
            revise=lambda plan, known: use_paper_method(
                plan, Paper(extra_mm=1.0), calibration=known
            ),
        ),
        "paper, soft": replace(
            soft("ball-33lbs"),
            revise=lambda plan, known: use_paper_method(plan, Paper(), calibration=known),
        ),
    }
    force = {"target_force_n": 4.0}
    for fault, phase, make in (
        ("finger at rest", "hold", rigid),
        ("frames stop", "squeeze", rigid),
        ("gripper runs on", "approach", soft),
    ):
        found[f"{fault} in {phase}"] = make("ball-44lbs", options=force, fault=fault, phase=phase)
    return found


def _golden(kind: GripperKind, thing: str | None, **case: Any) -> Golden:
    seed = _SHEET + len(thing or "")
    obj = None if thing is None else draw_object(np.random.default_rng([seed, 1]), thing)
    return Golden(
        case=Case(
            task="golden", seed=seed, sheet=_SHEET, kind=kind, level=_LEVELS[kind], obj=obj, **case
        )
    )


def run(golden: Golden) -> dict[str, Any]:
    """Make one grasp and summarize it."""
    known = golden.strip(golden.case.calibration)
    found = run_case(golden.case, calibration=known, revise=lambda plan: golden.revise(plan, known))
    result, truth = found.result, found.truth
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


def _ends(one: Measurement | None) -> list[Any] | None:
    if one is None:
        return None
    return [_short(one.value), _short(one.low), _short(one.high), str(one.status)]


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def main() -> None:
    """Write the summaries of all grasps."""
    rows = [f"{json.dumps(name)}: {json.dumps(run(one))}" for name, one in goldens().items()]
    KEPT.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main()
