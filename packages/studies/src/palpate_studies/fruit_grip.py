"""Grip real fruit in the simulated hand: palpate's damage limit compared with a fixed force cap.

The force curve and the rupture force of each fruit are recorded; sensor, hand and the relaxation at
rest are simulated. Limit and cap are learned from the other fruit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats import binomtest

from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.object.damage import FOLDS, NOMINAL_RATE, DamageModel
from palpate.object.damage_learning import (
    FruitClosing,
    learn_damage,
    read_closings,
    split_folds,
)
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.world import World
from palpate_studies.force_control_world import GRASPS_PER_SHEET, calibration_of
from palpate_studies.protocol.paired import compare
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, group

#: First seed of the grasps, fixed before anything was scored on them.
FIRST_SEED = 900_000
#: Nominal rates of damage.
RATES = (NOMINAL_RATE, 0.05)
#: Target of a grip that only the damage limit ends, N.
_TARGET_N = 14.0
#: Exponent of the force over the deformation before the first recorded force, the middle one of
#: `closing_curve`; smallest ratio of two forces of a curve, and its first force, N.
_EXPONENT, _RATIO, _FIRST_N = 1.25, 1.03, 0.05
LIMIT, CAP = "ours", "cap per fruit"


@dataclass(frozen=True, slots=True, kw_only=True)
class FruitGrip:
    """The outcome of one grip."""

    level: str
    method: str
    rate_limit: float
    grasp_id: str
    #: Largest true force, 0 without contact, and recorded rupture force.
    peak_n: float
    rupture_n: float

    @property
    def is_damaged(self) -> bool:
        """Whether the fruit was pressed beyond its recorded rupture force."""
        return self.peak_n >= self.rupture_n

    @property
    def loss(self) -> float:
        """Unused fraction of the rupture force; 1 for a damaged fruit."""
        return 1.0 if self.is_damaged else 1.0 - self.peak_n / self.rupture_n


def report(
    *,
    curves: Annotated[Path, typer.Option(help="Closings until rupture.", metavar="CSV")],
    index: Annotated[Path, typer.Option(help="Rupture forces of the closings.", metavar="CSV")],
    every: Annotated[int, typer.Option(help="Grip one fruit of this many.", min=1)] = 1,
) -> StudyReport:
    """Grip real fruit in the simulated hand, as firmly as a damage limit or a fixed cap allows.

    Example: palpate study fruit-grip --curves fruit.csv.gz --index fruit_index.csv
    """
    return judge(grip_all(read_closings(curves, index), every=every))


command = as_command(report)


def judge(found: Sequence[FruitGrip]) -> StudyReport:
    """Return the report of any number of grips."""
    summary = [
        {**key, **_score(part)} for key, part in group(found, "level", "rate_limit", "method")
    ]
    compared = []
    for key, part in group(found, "level", "rate_limit"):
        lost = {name["method"]: [one.loss for one in each] for name, each in group(part, "method")}
        fruits = [one.grasp_id for one in part if one.method == LIMIT]
        compared += compare(lost, fruits, ours=LIMIT, statistic=np.mean, **key)
    return StudyReport(
        name="fruit-grip",
        title="Gripping real fruit as firmly as its damage limit allows",
        provenance=(
            "Real force curves and rupture forces of fruit, gripped by the simulated rigid hand; "
            f"{FOLDS}-fold cross-validation by fruit, {GRASPS_PER_SHEET} grasps with each sensor.",
            "The limit is that of a grasp, learned from the recorded curves, with the kind given. "
            "The cap of a kind is the target of a grasp without a limit: a rank of the rupture "
            "forces of the other fruit.",
            "Grip: largest force / rupture force, 0 for a damaged fruit. Untouched: the grasp "
            "ended before contact.",
        ),
        tables=[
            Table.of(
                "Grip and damaged fruit",
                summary,
                (
                    "level",
                    "rate_limit",
                    "method",
                    "grasps",
                    "damaged",
                    "rate_low",
                    "rate_high",
                    "grip",
                    "mean_force_n",
                    "untouched",
                ),
            ),
            Table.of(
                "Loss (1 - grip): palpate minus baseline (90 % interval)",
                compared,
                ("level", "rate_limit", "rival", "difference", "low", "high", "verdict"),
            ),
        ],
        payload={"simulated": True, "summary": summary, "compared": compared},
    )


def _score(found: Sequence[FruitGrip]) -> dict[str, Any]:
    damaged, count = sum(one.is_damaged for one in found), len(found)
    interval = binomtest(damaged, count).proportion_ci(0.9)
    return {
        "grasps": count,
        "damaged": damaged,
        "rate_low": float(interval.low),
        "rate_high": float(interval.high),
        "grip": 1.0 - float(np.mean([one.loss for one in found])),
        "mean_force_n": float(np.mean([one.peak_n for one in found])),
        "untouched": sum(one.peak_n == 0.0 for one in found),
    }


def grip_all(closings: Sequence[FruitClosing], *, every: int = 1) -> list[FruitGrip]:
    """Grip one fruit of `every` with limit and cap, learned from all fruit of the other folds."""
    found, seed = list[FruitGrip](), FIRST_SEED
    for training, test in split_folds(closings):
        models = [learn_damage(training, rate=rate) for rate in RATES]
        for one in test:
            seed += 1
            if seed % every:
                continue
            for level in LEVELS:
                for model in models:
                    cap_n = choose_cap_n(training, kind=one.fruit, rate=model.rate)
                    grip = partial(_grip, one, seed=seed, level=level)
                    for method, peak_n in (
                        (LIMIT, grip(model=model)),
                        (CAP, grip(target_n=cap_n)),
                    ):
                        found.append(
                            FruitGrip(
                                level=level,
                                method=method,
                                rate_limit=model.rate,
                                grasp_id=one.grasp_id,
                                peak_n=peak_n,
                                rupture_n=one.rupture_force_n,
                            )
                        )
    return found


def choose_cap_n(training: Sequence[FruitClosing], *, kind: str, rate: float) -> float:
    """Return the force cap of a kind for a nominal rate, by conformal prediction, N.

    The k-th smallest rupture force of n bounds the rate on similar fruit by k / (n + 1). With too
    few fruit it is the smallest.
    """
    ordered = sorted(one.rupture_force_n for one in training if one.fruit == kind)
    return ordered[max(int(rate * (len(ordered) + 1)), 1) - 1]


def make_fruit(closing: FruitClosing, *, seed: int) -> TwinObject:
    """Return the recorded fruit as an object of the twin; size and relaxation are drawn.

    The recording begins under load. The deformation until then is extrapolated by a power law.
    """
    curve = _list_rising(closing)
    (x0, f0), (x1, f1) = curve[0], next((p for p in curve if p[1] > 2 * curve[0][1]), curve[-1])
    before_mm = (x1 - x0) / ((f1 / f0) ** (1 / _EXPONENT) - 1)
    return replace(
        draw_object(np.random.default_rng([seed, 35]), closing.fruit),
        yield_n=closing.rupture_force_n,
        rupture_n=1.2 * closing.rupture_force_n,
        curve=((0.0, 0.0), *((before_mm + x - x0, f) for x, f in curve)),
    )


def _list_rising(closing: FruitClosing) -> list[tuple[float, float]]:
    """Return closure and force of samples that exceed all earlier ones in both."""
    kept = list[tuple[float, float]]()
    for closure_mm, force_n in closing.samples.tolist():
        least_mm, least_n = (kept[-1][0], _RATIO * kept[-1][1]) if kept else (-np.inf, _FIRST_N)
        if closure_mm > least_mm and force_n > least_n:
            kept.append((closure_mm, force_n))
    return kept


def _grip(
    closing: FruitClosing,
    *,
    seed: int,
    level: str,
    model: DamageModel | None = None,
    target_n: float = _TARGET_N,
) -> float:
    """Grip to a force, or as firmly as a damage limit allows; return the largest true force, N."""
    sheet = seed // GRASPS_PER_SHEET
    world = World(
        make_fruit(closing, seed=seed), seed=seed, sheet_seed=sheet, level=level, gripper="rigid"
    )
    gripper = TwinGripper(world)
    plan = plan_grasp(
        calibration_of(sheet, level, "rigid"),
        gripper=gripper,
        target_force_n=target_n,
        damage=model,
        kind="" if model is None else closing.fruit,
        longest_s=300.0,
    )
    run_grasp(plan, array=TwinArray(world), gripper=gripper, clock=world.clock)
    return world.truth().peak_force_n
