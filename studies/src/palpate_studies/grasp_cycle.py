"""The main job: seconds from the open hand to a touch and to an answer, and what that risks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from itertools import product
from typing import Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.twin.ranges import Level
from palpate.twin.world import GripperKind
from palpate_studies.grasp_cycles import EXPECTED_WITHIN_MM, Cycle, Sample, cycles
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import OutOption, StudyReport, Table

LEVELS: tuple[Level, ...] = ("lab", "field")
KINDS: tuple[GripperKind, ...] = ("rigid", "soft")
#: Seed of the first object: none of them was looked at before the controller was as it is.
FIRST_SEED = 5_900_000
#: And of the first of the second generator, none of which was looked at before.
SECOND_SEED = 7_300_000
_COUNTED = ("touch_s", "answer_s", "touch_peak_n", "peak_n")


def command(
    grasps: Annotated[int, typer.Option(help="Objects of each hand and level.", min=4)] = 100,
    frame_rate_hz: Annotated[
        float, typer.Option(help="Frames per second; the firmware sends up to 250.", min=5.0)
    ] = 15.0,
    level: Annotated[Level | None, typer.Option(help="Only at this level of the twin.")] = None,
    second: Annotated[
        bool,
        typer.Option("--second", help="Things with a skin and a core, of foam, and of dough."),
    ] = False,
    firmware: Annotated[
        bool,
        typer.Option("--firmware", help="Read by the firmware, simulated; rigid, two ways alone."),
    ] = False,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Grasp fresh simulated objects by default settings, by the paper's way and by current alone.

    Example: palpate study grasp-cycle --grasps 40 --out reports
    """
    levels = (level,) if level else LEVELS
    found = report(
        grasps, frame_rate_hz=frame_rate_hz, levels=levels, second=second, firmware=firmware
    )
    found.emit(as_json=as_json, out=out)


def report(
    grasps: int,
    *,
    frame_rate_hz: float = 15.0,
    levels: Sequence[Level] = LEVELS,
    second: bool = False,
    firmware: bool = False,
) -> StudyReport:
    """Make the grasps and report them.

    `second`: of objects of the second generator. `firmware`: the firmware on the AVR simulator
    reads the sheet, on rigid fingers.
    """
    first_seed = SECOND_SEED if second else FIRST_SEED
    found = [
        cycle
        for level, kind in product(levels, KINDS[:1] if firmware else KINDS)
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
    return reported(found, frame_rate_hz=frame_rate_hz)


def reported(found: Sequence[Cycle], *, frame_rate_hz: float) -> StudyReport:
    """Report grasps: a row for each way, hand and level."""
    groups = dict[tuple[str, str, str], list[Cycle]]()
    for cycle in found:
        group = (cycle.sample.level, cycle.sample.kind, cycle.way)
        groups.setdefault(group, []).append(cycle)
    summary = [
        {"level": level, "hand": kind, "way": way, **scores(each)}
        for (level, kind, way), each in groups.items()
    ]
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
        tables=[times(summary), answers(summary), against(compared(found))],
        payload={
            "study": "grasp-cycle",
            "origin": "twin",
            "frame_rate_hz": frame_rate_hz,
            "summary": summary,
            "compared": compared(found),
            "grasps": [as_row(one) for one in found],
        },
    )


def scores(found: Sequence[Cycle]) -> dict[str, Any]:
    """Return times, forces and errors of one way; None where it measures nothing of the kind."""
    counted = dict[str, Any]()
    for name in _COUNTED:
        values = _known([getattr(one, name) for one in found])
        counted[f"{name}_median"] = _percentile(values, 50)
        counted[f"{name}_p95"] = _percentile(values, 95)
    size_mm = _known([one.size_error_mm for one in found])
    force = _known([one.force_error for one in found])
    settled = _known([one.settled_error for one in found])
    return {
        "grasps": len(found),
        "outcomes": dict(Counter(one.outcome for one in found)),
        "damaged": sum(one.damaged for one in found),
        **counted,
        "size_rms_mm": float(np.sqrt(np.mean(size_mm**2))) if size_mm.size else None,
        "force_median_error": _percentile(abs(force), 50),
        "settled_median_error": _percentile(abs(settled), 50),
        **_stiffness(found),
    }


def compared(found: Sequence[Cycle]) -> list[dict[str, Any]]:
    """Return by how much fewer objects ours damages than each rival, of the same objects."""
    damaged = dict[tuple[str, str, str], dict[int, bool]]()
    for one in found:
        group = damaged.setdefault((one.sample.level, one.sample.kind, one.way), {})
        group[one.sample.seed] = one.damaged
    sheets = {one.sample.seed: str(one.sample.sheet) for one in found}
    rows = list[dict[str, Any]]()
    for (level, kind, way), theirs in damaged.items():
        ours = damaged.get((level, kind, "ours"), {})
        if way.startswith("ours") or ours.keys() != theirs.keys():
            continue
        mine, rival = ([float(one[seed]) for seed in ours] for one in (ours, theirs))
        of = [sheets[seed] for seed in ours]
        difference = paired_difference(mine, rival, of, statistic=np.mean)
        rows.append({"level": level, "hand": kind, "rival": way, **difference.to_dict()})
    return rows


def _stiffness(found: Sequence[Cycle]) -> dict[str, Any]:
    """Return how well stiffness is measured where a number is given, and how often bounds hold."""
    numbers = [one for one in found if np.isfinite(one.stiffness)]
    bounds = [one for one in found if one.stiffness_status in ("at_least", "at_most")]
    return {
        "stiffness_numbers": len(numbers),
        "stiffness_median_error": _percentile(
            np.array([abs(one.stiffness / one.true_stiffness - 1.0) for one in numbers]), 50
        ),
        "stiffness_median_ratio": _percentile(
            np.array([one.stiffness_high / one.stiffness_low for one in numbers]), 50
        ),
        "stiffness_coverage": _share([_holds(one) for one in numbers]),
        "stiffness_bounds": len(bounds),
        "stiffness_bounds_right": _share([_holds(one) for one in bounds]),
    }


def _holds(one: Cycle) -> bool:
    """Whether the true stiffness lies within the ends that are known."""
    above = not one.true_stiffness < one.stiffness_low
    return above and not one.true_stiffness > one.stiffness_high


def _known(values: Sequence[float]) -> FloatArray:
    array = np.array(values, dtype=float)
    return np.asarray(array[np.isfinite(array)])


def _percentile(values: FloatArray, percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values.size else None


def _share(right: Sequence[bool]) -> float | None:
    return float(np.mean(right)) if right else None


def times(summary: Sequence[dict[str, Any]]) -> Table:
    """Return the table of when touch and answer came, and of the forces."""
    return Table(
        title="Seconds and newtons: median (95 %)",
        columns=(
            *("level", "hand", "way", "n", "touch, s", "answer, s"),
            *("force before the touch, N", "peak, N", "damaged", "held"),
        ),
        rows=[
            (
                *(row["level"], row["hand"], row["way"], str(row["grasps"])),
                *(_both(row, name) for name in _COUNTED),
                str(row["damaged"]),
                str(row["outcomes"].get("held", 0)),
            )
            for row in summary
        ],
    )


def answers(summary: Sequence[dict[str, Any]]) -> Table:
    """Return the table of size, force and stiffness."""
    return Table(
        title="Answers",
        columns=(
            *("level", "hand", "way", "size, RMS mm", "settled change, median error"),
            "force, median error",
            *("stiffness given", "median error", "high/low", "coverage", "bounds", "right"),
        ),
        rows=[
            (
                *(row["level"], row["hand"], row["way"]),
                _cell(row["size_rms_mm"], "{:.2f}"),
                _cell(row["settled_median_error"], "{:.0%}"),
                _cell(row["force_median_error"], "{:.0%}"),
                str(row["stiffness_numbers"]),
                _cell(row["stiffness_median_error"], "{:.0%}"),
                _cell(row["stiffness_median_ratio"], "{:.1f}"),
                _cell(row["stiffness_coverage"], "{:.2f}"),
                str(row["stiffness_bounds"]),
                _cell(row["stiffness_bounds_right"], "{:.2f}"),
            )
            for row in summary
        ],
    )


def against(rows: Sequence[dict[str, Any]]) -> Table:
    """Return the table of how many fewer objects are damaged; one sensor gives no interval."""
    return Table(
        title="Damaged in 1000: ours less the rival (90 %, by sensor)",
        columns=("level", "hand", "rival", "difference", "from", "to"),
        rows=[
            (
                *(row["level"], row["hand"], row["rival"]),
                *(_cell(_thousand(row[name]), "{:+.0f}") for name in ("difference", "low", "high")),
            )
            for row in rows
        ],
    )


def _thousand(share: float | None) -> float | None:
    return None if share is None else 1000.0 * share


def _both(row: dict[str, Any], name: str) -> str:
    median, most = row[f"{name}_median"], row[f"{name}_p95"]
    return "-" if median is None else f"{median:.1f} ({most:.1f})"


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def as_row(one: Cycle) -> dict[str, Any]:
    """Return a grasp for JSON; what is not known is None."""
    plain = asdict(one)
    every = {**plain.pop("sample"), **plain}
    del every["made"]
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value
        for name, value in every.items()
    }
