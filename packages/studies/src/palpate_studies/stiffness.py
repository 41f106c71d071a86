"""Stiffness in N/mm from the force-closure curve, corrected for the gripper's compliance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats import spearmanr

from palpate.calibration import Calibration
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.object.compliance import STIFFEST_N_PER_MM
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import GripperKind, World
from palpate_studies.force_control_world import draw_random_object
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, as_row, group, mean, median
from palpate_studies.stoppable import require_uninterrupted

#: Range of the stiffness: two decades, N/mm.
RANGE_N_PER_MM = (0.5, 50.0)
#: Force of the secant stiffness, newtons, and sizes of the objects.
FIRM_N, SIZES_MM = 10.0, (30.0, 60.0)
#: Target forces, newtons: None for a gentle squeeze, and a firm force within the hand's range.
SQUEEZES_N: dict[GripperKind, tuple[float | None, ...]] = {
    "rigid": (None, FIRM_N),
    "soft": (None, 6.0),
}
#: Objects of the repeatability test.
REPEATED_N_PER_MM = (1.0, 4.0, 16.0)
#: Bins of the summary; fingers, pads and servo together are a spring of about 4 N/mm.
EDGES_N_PER_MM = (RANGE_N_PER_MM[0], 2.0, 5.0, 15.0, RANGE_N_PER_MM[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class StiffnessAnswer:
    """Reported and true stiffness of one grasp, N/mm; NaN without an answer.

    `firmness`: the index, 0 to 100.
    """

    gripper: GripperKind
    level: str
    squeeze: str
    truth: float
    value: float
    low: float
    high: float
    status: str
    firmness: float


def report(
    *,
    grasps: Annotated[int, typer.Option(help="Objects of each level.", min=4)] = 24,
    seed: Annotated[int, typer.Option(help="First sensor.", min=0)] = 700,
    repeats: Annotated[
        int, typer.Option(help="Grasps of one object, for the repeatability.", min=2)
    ] = 10,
) -> StudyReport:
    """Grasp objects from 0.5 to 50 N/mm and compare the stiffness with the truth.

    Example: palpate study stiffness --out reports
    """
    found = [
        answer
        for gripper in SQUEEZES_N
        for level in LEVELS
        for k, stiffness in enumerate(np.geomspace(*RANGE_N_PER_MM, grasps))
        for answer in measure_object(
            level, gripper=gripper, seed=seed + k, stiffness=float(stiffness)
        )
    ]
    summary = list[dict[str, Any]]()
    for key, mine in group(found, "gripper", "level", "squeeze"):
        summary.append({**key, "range": "all", **scores(mine)})
        for low, high in pairwise(EDGES_N_PER_MM):
            part = [one for one in mine if low <= one.truth < high]
            summary.append({**key, "range": f"{low:g}-{high:g} N/mm", **scores(part)})
    repeated = [
        repeat_grasps(level, gripper=gripper, seed=seed + k, stiffness=stiffness, grasps=repeats)
        for gripper in SQUEEZES_N
        for level in LEVELS
        for k, stiffness in enumerate(REPEATED_N_PER_MM)
    ]
    return StudyReport(
        name="stiffness",
        title="Stiffness in N/mm, corrected for pads, fingers and servo (simulated)",
        provenance=(
            "Simulated: each grasp uses its own sensor and gripper, calibrated with a user's steps "
            "(load cell with changing faces, rigid block), and a new object, with a gentle squeeze "
            "or to a force. Half of the objects are linear, half have Hertz contact; half relax "
            "like fruit, by a tenth to a third, the others hardly. True: secant stiffness at the "
            "settled force.",
            "The compliance of the hand is in series. If it is a times the object's compliance, a "
            "relative force error causes a stiffness error 1 + a times as large. Soft fingers "
            "deflect by nearly 4 mm/N: they measure the softest objects, and for others a lower "
            "limit. No error is given if most intervals have no upper limit; `low / true` then "
            "shows the accuracy of the lower limit.",
        ),
        tables=[
            Table.of("Stiffness of objects over two decades", summary),
            Table.of("Gentle grasps of one object, each in another session", repeated),
        ],
        payload={
            "summary": summary,
            "repeated": repeated,
            "rows": [as_row(one) for one in found],
        },
    )


command = as_command(report)


def measure_object(
    level: str, *, seed: int, stiffness: float, gripper: GripperKind = "rigid"
) -> list[StiffnessAnswer]:
    """Calibrate one sensor on one hand, and grasp one object with each squeeze."""
    obj = draw_stiffness_object(stiffness, seed=seed)
    calibration = calibrate_twin(seed=seed, level=level, apart_from="", kind=gripper)
    return [
        _answer(
            World(obj, seed=seed, sheet_seed=seed, level=level, gripper=gripper),
            calibration,
            force_n,
            nominal=stiffness,
        )
        for force_n in SQUEEZES_N[gripper]
    ]


def repeat_grasps(
    level: str, *, seed: int, stiffness: float, gripper: GripperKind, grasps: int
) -> dict[str, Any]:
    """Grasp one object repeatedly on one sensor; return the spread of its firmness."""
    obj = draw_stiffness_object(stiffness, seed=seed)
    calibration = calibrate_twin(seed=seed, level=level, apart_from="", kind=gripper)
    answers = [
        _answer(
            World(obj, seed=seed + 10_000 * n, sheet_seed=seed, level=level, gripper=gripper),
            calibration,
            None,
            nominal=stiffness,
        )
        for n in range(1, grasps + 1)
    ]
    firmness = np.array([one.firmness for one in answers if np.isfinite(one.firmness)])
    log_n_per_mm = np.log([one.value for one in answers if np.isfinite(one.value)])
    return {
        "gripper": gripper,
        "level": level,
        "stiffness": stiffness,
        "grasps": len(firmness),
        "mean": float(firmness.mean()),
        "sd": float(firmness.std(ddof=1)),
        "log_sd": float(log_n_per_mm.std(ddof=1)),
    }


def draw_stiffness_object(stiffness: float, *, seed: int) -> TwinObject:
    """Draw an object of a given secant stiffness that withstands any force.

    Half of the objects are flat, half round; half elastic, half relaxing, as in the force control
    study.
    """
    obj = draw_random_object(np.random.default_rng([seed, 21]), size_mm=SIZES_MM)
    deformation_mm = FIRM_N / stiffness
    return replace(
        obj,
        name=f"{stiffness:.2g} N/mm",
        force_at_1mm_n=FIRM_N / deformation_mm**obj.exponent,
        yield_n=math.inf,
        rupture_n=math.inf,
    )


def _answer(
    world: World,
    calibration: Calibration,
    target_force_n: float | None,
    *,
    nominal: float,
) -> StiffnessAnswer:
    gripper = TwinGripper(world)
    result = require_uninterrupted(
        run_grasp(
            plan_grasp(calibration, gripper=gripper, target_force_n=target_force_n),
            array=TwinArray(world),
            gripper=gripper,
            clock=world.clock,
        )
    )
    truth = world.truth().stiffness_n_per_mm
    found = None if truth is None else result.stiffness_n_per_mm
    return StiffnessAnswer(
        gripper=world.gripper,
        level=world.level,
        squeeze="gentle" if target_force_n is None else f"{target_force_n:g} N",
        truth=nominal if truth is None else truth,
        value=found.middle if found else np.nan,
        low=found.low if found else np.nan,
        high=found.high if found else np.nan,
        status=str(found.status) if found else "none",
        firmness=np.nan if result.firmness is None else result.firmness.middle,
    )


def scores(answers: Sequence[StiffnessAnswer]) -> dict[str, Any]:
    """Return error and width of the answers, and the number without an upper limit."""
    given = [one for one in answers if np.isfinite(one.value)]
    # Intervals that include a rigid object; other wide intervals are reported as bounds too.
    open_above = sum(one.high >= STIFFEST_N_PER_MM for one in given)
    # If most intervals have no upper limit, their middle is not a meaningful value.
    valued = 2 * open_above < len(given)
    error = [100 * abs(one.value / one.truth - 1) for one in given]
    width = [one.high / one.low for one in given if one.low > 0]
    bound = [one.low / one.truth for one in given]
    firm = [one for one in answers if np.isfinite(one.firmness)]
    truths = [one.truth for one in firm]
    rank = None
    # A rank correlation needs at least three different objects.
    if len(set(truths)) > 2:
        rank = float(spearmanr([one.firmness for one in firm], truths).statistic)
    return {
        "grasps": len(answers),
        "answered": len(given),
        "no_upper_end": open_above,
        "median_abs_error_percent": float(np.median(error)) if valued else None,
        "coverage": mean([one.low <= one.truth <= one.high for one in given]),
        "median_high_over_low": median(width) if valued else None,
        "median_low_over_true": median(bound),
        "with_firmness": len(firm),
        "firmness_rank": rank,
    }
