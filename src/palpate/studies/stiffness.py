"""Stiffness in N/mm from the force-closure curve, the gripper's own compliance taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.rig.simulated import calibrated
from palpate.studies.report import JsonOption, OutOption, StudyReport, Table
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject
from palpate.twin.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = ("paper", "field")
#: Two decades, N/mm.
RANGE_N_PER_MM = (0.5, 50.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One grasp: what was said of the stiffness and what was true, N/mm; NaN where not answered."""

    level: str
    truth: float
    value: float
    low: float
    high: float
    status: str


def command(
    grasps: Annotated[int, typer.Option(help="Grasps of each level.", min=4)] = 24,
    target_force_n: Annotated[
        float | None,
        typer.Option(help="Grip force to reach; a gentle squeeze by default.", min=0.5),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Grasp linear objects from 0.5 to 50 N/mm and compare the stiffness with the true one.

    Example: palpate study stiffness --out reports
    """
    answers = [
        _answer(level, seed=700 + k, stiffness=float(stiffness), target_force_n=target_force_n)
        for level in LEVELS
        for k, stiffness in enumerate(np.geomspace(*RANGE_N_PER_MM, grasps))
    ]
    _report(answers, target_force_n=target_force_n).emit(as_json=as_json, out=out)


def _answer(level: str, *, seed: int, stiffness: float, target_force_n: float | None) -> Answer:
    rng = np.random.default_rng([seed, 21])
    obj = TwinObject(
        name=f"{stiffness:.2g} N/mm",
        size_mm=float(rng.uniform(30, 60)),
        contact="linear",
        force_at_1mm_n=stiffness,
        relaxing_share=(0.01, 0.01, 0.01),
        relaxing_time_s=(0.5, 3.0, 20.0),
        flat=bool(rng.random() < 0.5),
    )
    calibration = calibrated(seed=seed, level=level, apart_from="")
    world = World(obj, seed=seed, sheet_seed=seed, level=level)
    gripper = TwinGripper(world)
    result = run_grasp(
        plan_grasp(calibration, gripper=gripper, target_force_n=target_force_n),
        array=TwinArray(world),
        gripper=gripper,
        clock=world.clock,
    )
    truth, found = world.truth().stiffness_n_per_mm, result.stiffness_n_per_mm
    if truth is None or found is None:
        return Answer(
            level=level, truth=stiffness, value=np.nan, low=np.nan, high=np.nan, status="none"
        )
    return Answer(
        level=level,
        truth=truth,
        value=found.value,
        low=found.low,
        high=found.high,
        status=str(found.status),
    )


def _scores(answers: Sequence[Answer]) -> dict[str, Any]:
    given = [one for one in answers if np.isfinite(one.value)]
    error = [100 * abs(one.value / one.truth - 1) for one in given]
    width = [one.high / one.low for one in given if one.low > 0]
    return {
        "grasps": len(answers),
        "answered": len(given),
        "median_abs_error_percent": float(np.median(error)) if error else None,
        "coverage": float(np.mean([o.low <= o.truth <= o.high for o in given])) if given else None,
        "median_high_over_low": float(np.median(width)) if width else None,
    }


def _report(answers: Sequence[Answer], *, target_force_n: float | None) -> StudyReport:
    edges = (RANGE_N_PER_MM[0], 5.0, RANGE_N_PER_MM[1])
    squeeze = "a gentle squeeze" if target_force_n is None else f"{target_force_n:g} N"
    summary = []
    for level in LEVELS:
        mine = [one for one in answers if one.level == level]
        summary.append({"level": level, "range": "all", **_scores(mine)})
        for low, high in pairwise(edges):
            part = [one for one in mine if low <= one.truth < high]
            summary.append({"level": level, "range": f"{low:g}-{high:g} N/mm", **_scores(part)})
    keys = {
        "median_abs_error_percent": "median error, %",
        "coverage": "coverage (0.9)",
        "median_high_over_low": "high / low",
    }
    table = Table(
        title="Stiffness of linear objects over two decades",
        columns=("level", "range", "grasps", "answered", *keys.values()),
        rows=[
            [row["level"], row["range"], str(row["grasps"]), str(row["answered"])]
            + ["-" if row[key] is None else f"{row[key]:.2f}" for key in keys]
            for row in summary
        ],
    )
    return StudyReport(
        name="stiffness",
        title="Stiffness in N/mm, pads, fingers and servo taken out (simulated)",
        provenance=(
            "Simulated: each grasp on a sensor and gripper of its own, calibrated by a user's "
            f"steps (load cell with changing faces, rigid block), then one grasp ({squeeze}) of an "
            "object it never saw. True: secant stiffness at the settled force.",
        ),
        tables=[table],
        payload={
            "summary": summary,
            "rows": [
                {
                    name: (
                        None if isinstance(v := getattr(one, name), float) and np.isnan(v) else v
                    )
                    for name in Answer.__slots__
                }
                for one in answers
            ],
        },
        figures={"stiffness": lambda: _figure(answers)},
    )


def _figure(answers: Sequence[Answer]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.8, 4.2), layout="constrained")
    for panel, level in zip(figure.subplots(1, 2, sharex=True, sharey=True), LEVELS, strict=True):
        mine = [one for one in answers if one.level == level and np.isfinite(one.value)]
        truth, value = (np.array([getattr(o, n) for o in mine]) for n in ("truth", "value"))
        ends = np.array([(max(o.value - o.low, 0), max(o.high - o.value, 0)) for o in mine]).T
        panel.errorbar(
            truth,
            value,
            yerr=ends if len(mine) else None,
            fmt="o",
            ms=4,
            lw=1,
            color="#0072B2",
            ecolor="#88B8DA",
        )
        panel.plot(RANGE_N_PER_MM, RANGE_N_PER_MM, color="#999999", lw=1)
        panel.set(xscale="log", yscale="log", xlabel="true stiffness, N/mm", title=f"twin, {level}")
        panel.set_ylim(RANGE_N_PER_MM[0] / 4, RANGE_N_PER_MM[1] * 12)
        panel.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("stiffness said, with its interval, N/mm")
    return figure
