"""Stiffness in N/mm from the force-closure curve, the gripper's own compliance taken out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate.commands.options import JsonOption
from palpate.estimate.compliance import STIFFEST_N_PER_MM
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.rig.simulated import calibrated
from palpate.sensor.calibration import Calibration
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject
from palpate.twin.world import GripperKind, World
from palpate_studies.force_control_world import FRUIT_RELAXES, thing
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.stoppable import uninterrupted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEVELS = ("lab", "field")
#: Two decades, N/mm.
RANGE_N_PER_MM = (0.5, 50.0)
#: Objects have that secant stiffness under this force, newtons; and their sizes.
FIRM_N, SIZES_MM = 10.0, (30.0, 60.0)
#: A gentle squeeze, just enough to measure, and a firm one that the hand can do, newtons.
SQUEEZES_N: dict[GripperKind, tuple[float | None, ...]] = {
    "rigid": (None, FIRM_N),
    "soft": (None, 6.0),
}
#: Where the summary is cut: fingers, pads and servo together are a spring of about 4 N/mm.
EDGES_N_PER_MM = (RANGE_N_PER_MM[0], 2.0, 5.0, 15.0, RANGE_N_PER_MM[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One grasp: reported and true stiffness, N/mm; NaN where not answered.

    `object` describes how it presses back: see `_kind_of`.
    """

    gripper: GripperKind
    level: str
    squeeze: str
    object: str
    truth: float
    value: float
    low: float
    high: float
    status: str


def command(
    grasps: Annotated[int, typer.Option(help="Objects of each level.", min=4)] = 24,
    seed: Annotated[int, typer.Option(help="First sensor.", min=0)] = 700,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Grasp objects from 0.5 to 50 N/mm and compare the stiffness with the true one.

    Example: palpate study stiffness --out reports
    """
    answers = [
        answer
        for gripper in SQUEEZES_N
        for level in LEVELS
        for k, stiffness in enumerate(np.geomspace(*RANGE_N_PER_MM, grasps))
        for answer in answers_of(level, gripper=gripper, seed=seed + k, stiffness=float(stiffness))
    ]
    _report(answers).emit(as_json=as_json, out=out)


def answers_of(
    level: str, *, seed: int, stiffness: float, gripper: GripperKind = "rigid"
) -> list[Answer]:
    """Calibrate one sensor on one hand, and grasp one object with each squeeze."""
    obj = object_of(stiffness, seed=seed)
    calibration = calibrated(seed=seed, level=level, apart_from="", kind=gripper)
    worlds = partial(World, obj, seed=seed, sheet_seed=seed, level=level, gripper=gripper)
    return [
        _answer(worlds(), calibration, force_n, obj=obj, nominal=stiffness)
        for force_n in SQUEEZES_N[gripper]
    ]


def object_of(stiffness: float, *, seed: int) -> TwinObject:
    """Draw an object of a secant stiffness: flat or round, like a spring or relaxing like fruit.

    Half of them are of each, as the things of the force control study are; they stand any force.
    """
    obj = thing(np.random.default_rng([seed, 21]), size_mm=SIZES_MM)
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
    obj: TwinObject,
    nominal: float,
) -> Answer:
    gripper = TwinGripper(world)
    result = uninterrupted(
        run_grasp(
            plan_grasp(calibration, gripper=gripper, target_force_n=target_force_n),
            array=TwinArray(world),
            gripper=gripper,
            clock=world.clock,
        )
    )
    truth, found = world.truth().stiffness_n_per_mm, result.stiffness_n_per_mm
    answered = truth is not None and found is not None
    return Answer(
        gripper=world.gripper,
        level=world.level,
        squeeze="gentle" if target_force_n is None else f"{target_force_n:g} N",
        object=_kind_of(obj),
        truth=nominal if truth is None else truth,
        value=found.middle if answered and found else np.nan,
        low=found.low if answered and found else np.nan,
        high=found.high if answered and found else np.nan,
        status=str(found.status) if answered and found else "none",
    )


def _kind_of(obj: TwinObject) -> str:
    """Return what an object is like: flat or round contact, relaxing like fruit or hardly."""
    relaxing = "fruit" if sum(obj.relaxing_share) >= FRUIT_RELAXES[0] else "spring"
    return f"{relaxing}, {'round' if obj.contact == 'hertz' else 'flat'}"


def scores(answers: Sequence[Answer]) -> dict[str, Any]:
    """Return how near answers come, how wide they are, and how many exclude no rigid object."""
    given = [one for one in answers if np.isfinite(one.value)]
    open_above = sum(map(_open_above, given))
    # Mostly without an upper end, the middle of what is possible is no value to be judged.
    valued = 2 * open_above < len(given)
    error = [100 * abs(one.value / one.truth - 1) for one in given]
    width = [one.high / one.low for one in given if one.low > 0]
    bound = [one.low / one.truth for one in given]
    return {
        "grasps": len(answers),
        "answered": len(given),
        "no_upper_end": open_above,
        "median_abs_error_percent": float(np.median(error)) if valued else None,
        "coverage": float(np.mean([o.low <= o.truth <= o.high for o in given])) if given else None,
        "median_high_over_low": float(np.median(width)) if valued and width else None,
        "median_low_over_true": float(np.median(bound)) if bound else None,
    }


def _open_above(answer: Answer) -> bool:
    """Whether nothing rigid is excluded; a grasp reports other wide intervals as bounds too."""
    return answer.high >= STIFFEST_N_PER_MM


def _summary(answers: Sequence[Answer]) -> list[dict[str, Any]]:
    """Return scores of each hand, level and squeeze: of all, by stiffness, and by kind."""
    summary = []
    for key in dict.fromkeys(_kind(one) for one in answers):
        mine = [one for one in answers if _kind(one) == key]
        named = dict(zip(("gripper", "level", "squeeze"), key, strict=True))
        summary.append({**named, "range": "all", **scores(mine)})
        for low, high in pairwise(EDGES_N_PER_MM):
            part = [one for one in mine if low <= one.truth < high]
            summary.append({**named, "range": f"{low:g}-{high:g} N/mm", **scores(part)})
        for kind in sorted({one.object for one in mine}):
            part = [one for one in mine if one.object == kind]
            summary.append({**named, "range": kind, **scores(part)})
    return summary


def _kind(one: Answer) -> tuple[str, str, str]:
    return one.gripper, one.level, one.squeeze


def _report(answers: Sequence[Answer]) -> StudyReport:
    summary = _summary(answers)
    keys = {
        "median_abs_error_percent": "median error, %",
        "coverage": "coverage (0.9)",
        "median_high_over_low": "high / low",
        "median_low_over_true": "low / true",
    }
    table = Table(
        title="Stiffness of objects over two decades",
        columns=(
            *("hand", "level", "squeeze", "range", "grasps", "answered", "no upper end"),
            *keys.values(),
        ),
        rows=[
            [row["gripper"], row["level"], row["squeeze"], row["range"]]
            + [str(row[name]) for name in ("grasps", "answered", "no_upper_end")]
            + ["-" if row[key] is None else f"{row[key]:.2f}" for key in keys]
            for row in summary
        ],
    )
    return StudyReport(
        name="stiffness",
        title="Stiffness in N/mm, pads, fingers and servo taken out (simulated)",
        provenance=(
            "Simulated: each grasp on a sensor and gripper of its own, calibrated by a user's "
            "steps (load cell with changing faces, rigid block), then one grasp of an object it "
            "never saw: a gentle squeeze, or to a force. Half of the objects press back in "
            "proportion, half like round ones (Hertz); half relax as fruit does, by a tenth to a "
            "third, the others hardly. True: secant stiffness at the settled force.",
            "The give of the hand is in series: where it is a times the object's own, an error of "
            "the force comes back 1 + a times in the stiffness.",
            "Soft fingers give way by nearly 4 mm/N: they measure the softest things, and of "
            "others a lower end. Where most have no upper end no error is given; `low / true` "
            "shows how near the lower end comes. Their intervals cover at every stiffness as "
            "often as they claim, so of things that are rigid to them one in ten gets an upper "
            "end.",
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
    from palpate.plots.style import legend_below, new_figure

    rows = list(dict.fromkeys((one.gripper, one.squeeze) for one in answers))
    with new_figure(
        rows=len(rows),
        columns=len(LEVELS),
        width_in=7.2,
        height_in=0.4 + 2.1 * len(rows),
        shared=True,
    ) as (figure, panels):
        for row, (gripper, squeeze) in zip(panels, rows, strict=True):
            for panel, level in zip(row, LEVELS, strict=True):
                mine = [
                    one
                    for one in answers
                    if _kind(one) == (gripper, level, squeeze) and np.isfinite(one.value)
                ]
                _draw(panel, mine)
                panel.set_title(f"simulated, {level}, {gripper} fingers, {squeeze}")
            row[0].set_ylabel("reported stiffness (N/mm)")
        for panel in panels[-1]:
            panel.set_xlabel("true stiffness (N/mm)")
        legend_below(figure, panels)
    return figure


def _draw(panel: Axes, answers: Sequence[Answer]) -> None:
    from palpate.plots.style import log_axis

    for open_above, colour, pale, label in (
        (False, "#0072B2", "#88B8DA", "90 % interval"),
        (True, "#777777", "#CCCCCC", "no upper end"),
    ):
        mine = [one for one in answers if _open_above(one) == open_above]
        ends = np.array([(max(o.value - o.low, 0), max(o.high - o.value, 0)) for o in mine]).T
        panel.errorbar(
            [one.truth for one in mine],
            [one.value for one in mine],
            yerr=ends if mine else None,
            fmt="o",
            ms=3,
            lw=1,
            color=colour,
            ecolor=pale,
            label=label,
        )
    panel.plot(RANGE_N_PER_MM, RANGE_N_PER_MM, color="#222222", lw=1, label="exact")
    log_axis(panel.xaxis)
    log_axis(panel.yaxis)
    panel.set_ylim(RANGE_N_PER_MM[0] / 12, RANGE_N_PER_MM[1] * 12)
