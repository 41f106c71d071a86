"""The main job: seconds from the open hand to a touch and to an answer, and what that risks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product
from typing import Annotated, Any

import numpy as np
import typer

from palpate.twin.world import GripperKind
from palpate_studies.grasp_cycles import EXPECTED_WITHIN_MM, Cycle, Sample, cycles
from palpate_studies.protocol.paired import compare
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, group, mean, median

KINDS: tuple[GripperKind, ...] = ("rigid", "soft")
#: Seed of the first object: none of them was looked at before the controller was as it is.
FIRST_SEED = 5_900_000
#: And of the first of the second generator, none of which was looked at before.
SECOND_SEED = 7_300_000


def report(
    *,
    grasps: Annotated[int, typer.Option(help="Objects of each hand and level.", min=4)] = 100,
    frame_rate_hz: Annotated[
        float, typer.Option(help="Frames per second; the firmware sends up to 250.", min=5.0)
    ] = 15.0,
    second: SecondOption = False,
    firmware: Annotated[
        bool,
        typer.Option("--firmware", help="Read by the firmware, simulated; rigid, two ways alone."),
    ] = False,
) -> StudyReport:
    """Grasp fresh simulated objects by default settings, by the paper's way and by current alone.

    Example: palpate study grasp-cycle --grasps 40 --out reports
    """
    first_seed = SECOND_SEED if second else FIRST_SEED
    found = [
        cycle
        for level, kind in product(LEVELS, KINDS[:1] if firmware else KINDS)
        for number in range(grasps)
        for cycle in cycles(
            Sample(
                seed=first_seed + number,
                level=level,
                kind=kind,
                frame_rate_hz=frame_rate_hz,
                second=second,
                firmware=firmware,
            )
        )
    ]
    return judge(found, frame_rate_hz=frame_rate_hz)


command = as_command(report)


def judge(found: Sequence[Cycle], *, frame_rate_hz: float) -> StudyReport:
    """Report grasps: a row for each way, hand and level."""
    summary = [
        {"level": key["level"], "hand": key["kind"], "way": key["way"], **scores(each)}
        for key, each in group(found, "sample.level", "sample.kind", "way")
    ]
    lead = {"level": "{level}", "hand": "{hand}", "way": "{way}"}
    rivals = compared(found)
    return StudyReport(
        name="grasp-cycle",
        title="A gentle grasp from the open hand to the answer (simulated)",
        provenance=[
            f"Simulated at {frame_rate_hz:g} frames/s: random objects of two decades of stiffness, "
            "flat or round, half of them relaxing as fruit does, each with a strength of its own; "
            "four to a sensor and gripper, calibrated on the twin.",
            "Default settings: a gentle squeeze, no damage limit. Rivals: steps of 1 mm (0.8 kPa) "
            "until the mean of all pixels has fallen by 10 %, with the prediction at 2.5 s, as in "
            "the paper; the same until the mean of each finger has; and closing at "
            "10 mm/s until the servo's current shows 2 N.",
            f"An expected size is off by up to {EXPECTED_WITHIN_MM:g} mm.",
        ],
        tables=[
            Table.of(
                "Seconds and newtons: median (95 %)",
                summary,
                {
                    **lead,
                    "n": "{grasps}",
                    "touch, s": "{touch_s_median:.1f} ({touch_s_p95:.1f})",
                    "answer, s": "{answer_s_median:.1f} ({answer_s_p95:.1f})",
                    "before the touch, N": "{touch_peak_n_median:.1f} ({touch_peak_n_p95:.1f})",
                    "peak, N": "{peak_n_median:.1f} ({peak_n_p95:.1f})",
                    "damaged": "{damaged}",
                    "held": lambda row: str(row["outcomes"].get("held", 0)),
                },
            ),
            Table.of(
                "Answers",
                summary,
                {
                    **lead,
                    "size, RMS mm": "{size_rms_mm:.2f}",
                    "settled change, median error": "{settled_median_error:.0%}",
                    "force, median error": "{force_median_error:.0%}",
                    "stiffness given": "{stiffness_numbers}",
                    "median error": "{stiffness_median_error:.0%}",
                    "high/low": "{stiffness_median_ratio:.1f}",
                    "coverage": "{stiffness_coverage:.2f}",
                    "bounds": "{stiffness_bounds}",
                    "right": "{stiffness_bounds_right:.2f}",
                },
            ),
            Table.of(
                "Damaged, percent: ours less the rival (90 %, by sensor)",
                rivals,
                {
                    "level": "{level}",
                    "hand": "{hand}",
                    "rival": "{rival}",
                    "difference": "{difference:+.1p}",
                    "from": "{low:+.1p}",
                    "to": "{high:+.1p}",
                },
            ),
        ],
        payload={
            "study": "grasp-cycle",
            "origin": "twin",
            "frame_rate_hz": frame_rate_hz,
            "summary": summary,
            "compared": rivals,
        },
    )


def scores(found: Sequence[Cycle]) -> dict[str, Any]:
    """Return times, forces and errors of one way; None where it measures nothing of the kind."""

    def middle(name: str, share: float = 0.5) -> float | None:
        return median([abs(getattr(one, name)) for one in found], share)

    numbers = [one for one in found if np.isfinite(one.stiffness)]
    bounds = [one for one in found if one.stiffness_status in ("at_least", "at_most")]
    size_mm = mean([one.size_error_mm**2 for one in found])
    return {
        "grasps": len(found),
        "outcomes": dict(Counter(one.outcome for one in found)),
        "damaged": sum(one.damaged for one in found),
        **{
            f"{name}_{end}": middle(name, share)
            for name in ("touch_s", "answer_s", "touch_peak_n", "peak_n")
            for end, share in (("median", 0.5), ("p95", 0.95))
        },
        "size_rms_mm": None if size_mm is None else float(np.sqrt(size_mm)),
        "force_median_error": middle("force_error"),
        "settled_median_error": middle("settled_error"),
        "stiffness_numbers": len(numbers),
        "stiffness_median_error": median(
            [abs(one.stiffness / one.true_stiffness - 1.0) for one in numbers]
        ),
        "stiffness_median_ratio": median(
            [one.stiffness_high / one.stiffness_low for one in numbers]
        ),
        "stiffness_coverage": mean([_holds(one) for one in numbers]),
        "stiffness_bounds": len(bounds),
        "stiffness_bounds_right": mean([_holds(one) for one in bounds]),
    }


def compared(found: Sequence[Cycle]) -> list[dict[str, Any]]:
    """Return by how much fewer objects ours damages than each rival, of the same objects."""
    rows = list[dict[str, Any]]()
    for key, every in group(found, "sample.level", "sample.kind"):
        by_way = {name["way"]: each for name, each in group(every, "way")}
        ours = {one.sample.seed: float(one.damaged) for one in by_way.get("ours", [])}
        sheets = [str(one.sample.sheet) for one in by_way.get("ours", [])]
        for way, each in by_way.items():
            theirs = {one.sample.seed: float(one.damaged) for one in each}
            if not way.startswith("ours") and ours.keys() == theirs.keys():
                pair = {"ours": list(ours.values()), way: [theirs[seed] for seed in ours]}
                named = {"level": key["level"], "hand": key["kind"]}
                rows += compare(pair, sheets, statistic=np.mean, **named)
    return rows


def _holds(one: Cycle) -> bool:
    """Whether the true stiffness lies within the ends that are known."""
    above = not one.true_stiffness < one.stiffness_low
    return above and not one.true_stiffness > one.stiffness_high
