"""Figure 16 of the paper, and ripeness of many fruits: stages, days to ripe, drift told apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
import typer

from palpate.errors import InputError
from palpate.produce.ripeness import SURE
from palpate.produce.ripeness_stages import STAGES
from palpate.studies.report import JsonOption, OutOption, StudyReport, Table
from palpate.studies.ripeness_felt import Felt, drift_of
from palpate.studies.ripeness_scores import (
    MARGINS,
    WAYS,
    Judged,
    confusion,
    judged,
    scores,
)
from palpate.studies.ripeness_station import (
    DAYS,
    GRASPS_AT_ONCE,
    LABELLED_GRASPS,
    LATER_DAYS,
    MOST_GRASPS,
    REFERENCE_GRASPS,
    run_station,
)
from palpate.twin.world import GripperKind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Level, gripper and whether the sensor ages: what is compared.
Condition: TypeAlias = tuple[str, GripperKind, bool]
CONDITIONS: tuple[Condition, ...] = (
    ("paper", "rigid", True),
    ("paper", "soft", True),
    ("paper", "rigid", False),
    ("paper", "soft", False),
    ("field", "rigid", True),
    ("field", "soft", True),
)
#: Seeds of the sensors that are reported; none of them was looked at before.
SEED, LABELLED = 93001, 24


def command(
    sensors: Annotated[int, typer.Option(help="Sensors of each condition.", min=1)] = 1,
    fruits: Annotated[
        int,
        typer.Option(help="Fruits that each sensor judges, beside two dozen labelled ones.", min=2),
    ] = 10,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Follow avocados of the twin over four days with both grippers, on sensors that age.

    By default it takes a quarter of an hour; `--sensors 5 --fruits 40` takes some hours.

    Example: palpate study ripeness --out reports
    """
    found = {
        (level, gripper, aging): [
            run_station(
                SEED + sensor,
                level=level,
                gripper=gripper,
                aging=aging,
                labelled=LABELLED,
                others=fruits,
            )
            for sensor in range(sensors)
        ]
        for level, gripper, aging in CONDITIONS
    }
    report(found).emit(as_json=as_json, out=out)


def report(found: Mapping[Condition, Sequence[Felt]]) -> StudyReport:
    """Judge what the stations felt, condition by condition."""
    rows = {
        condition: [row for felt in stations for row in judged(felt)]
        for condition, stations in found.items()
    }
    if not all(any(row.wait_days > 0 for row in one) for one in rows.values()):
        raise InputError("all fruits were ripe from the first day on: judge more with --fruits")
    each = {condition: scores(rows[condition]) for condition in rows}
    fruits = {c: sum(len(felt.others) for felt in found[c]) for c in found}
    return StudyReport(
        name="ripeness",
        title="Figure 16 and ripeness over days (simulated)",
        provenance=_provenance(found),
        tables=[
            _accuracy_table(each, fruits),
            _limits_table(each),
            _days_table(each),
            *(_confusion_table(c, rows[c]) for c in rows if c[0] == "paper" and c[2]),
            _figure16_table(found),
        ],
        payload={
            "study": "ripeness",
            "origin": "twin",
            "conditions": [
                {
                    "level": condition[0],
                    "gripper": condition[1],
                    "aging": condition[2],
                    "sensors": len(found[condition]),
                    "fruits": fruits[condition],
                    "grasps": sum(len(felt.grasps) for felt in found[condition]),
                    "damaged": sum(felt.damaged for felt in found[condition]),
                    "reference_moved": [
                        [float(one) for one in drift_of(felt).moved] for felt in found[condition]
                    ],
                    "confusion": confusion(rows[condition]).tolist(),
                    **each[condition],
                }
                for condition in found
            ],
        },
        figures={
            "figure16": lambda: _figure16(found),
            "ripeness": lambda: _figure(each, rows),
        },
    )


def _provenance(found: Mapping[Condition, Sequence[Felt]]) -> list[str]:
    damaged = sum(felt.damaged for stations in found.values() for felt in stations)
    grasps = sum(len(felt.grasps) for stations in found.values() for felt in stations)
    return [
        "Simulated throughout. The paper prints no numbers in Figure 16 (one avocado, four days, "
        "ten grasps a day, each gripper); no published number was a calibration input here. The "
        "avocados' ranges stand in `palpate.twin.produce_ranges` with their reasons.",
        f"Each sensor: a calibration by a user's steps, then {LABELLED} labelled fruits for {DAYS} "
        f"days (more where these did not show every stage), {LABELLED_GRASPS} grasps a day, and, "
        f"{LATER_DAYS} days after their first, the others, which are judged: {GRASPS_AT_ONCE} "
        f"grasps a day, and {GRASPS_AT_ONCE} more up to {MOST_GRASPS} while the stage is less than "
        f"{100 * SURE:.0f} % sure. A nest centres the fruit. {REFERENCE_GRASPS} grasps of a rubber "
        "ball each morning, half before the fruit and half after it; rest values taken anew each "
        "morning with the hand empty. Judged on each day by the days up to then.",
        "Aging: break-in and wear by 100 to 400 other grasps a day, mornings at 14.8 to 26.8 C.",
        "Labels are true stages; people err, and then no one is right more often than they are.",
        f"Pressed beyond its yield: {damaged} of {grasps} grasps.",
    ]


def _named(condition: Condition) -> list[str]:
    level, gripper, aging = condition
    return [level, gripper, "on" if aging else "off"]


def _accuracy_table(
    each: Mapping[Condition, Mapping[str, Any]], fruits: Mapping[Condition, int]
) -> Table:
    def cell(score: Mapping[str, float] | None) -> str:
        if score is None:
            return "-"
        return f"{100 * score['exact']:.1f} / {100 * score['within_one']:.1f}"

    return Table(
        title="Stage of four: exact / within one, % of fruit days",
        columns=("level", "gripper", "aging", "fruits", "fruit days", *WAYS),
        rows=[
            [
                *_named(condition),
                str(fruits[condition]),
                str(score["fruit_days"]),
                *(cell(score[way]) for way in WAYS),
            ]
            for condition, score in each.items()
        ],
    )


def _limits_table(each: Mapping[Condition, Mapping[str, Any]]) -> Table:
    edges = [f"{100 * np.expm1(edge):.0f}" for edge in MARGINS[:-1]]
    spans = [f"{a} to {b} %" for a, b in pairwise(edges)] + [f"beyond {edges[-1]} %"]
    rows = []
    for condition, score in each.items():
        found = {round(one["from_percent"]): one for one in score["by_margin"]}
        cells = [
            f"{100 * one['exact']:.0f} of {one['fruit_days']} ({100 * one['possible']:.0f})"
            if (one := found.get(int(edge))) is not None
            else "-"
            for edge in edges
        ]
        rows.append([*_named(condition), f"{100 * score['possible']:.1f}", *cells])
    return Table(
        title="Exact, %, by how far the force at 1 mm is from a boundary; (what "
        "as many grasps that day would reach if they measured without any error)",
        columns=("level", "gripper", "aging", "possible, all", *spans),
        rows=rows,
    )


def _days_table(each: Mapping[Condition, Mapping[str, Any]]) -> Table:
    return Table(
        title="Days to ripe, of fruit not ripe yet; 90 % interval",
        columns=("level", "gripper", "aging", "fruit days", "coverage", "median error", "width"),
        rows=[
            [
                *_named(condition),
                str(score["days_to_ripe"]["fruit_days"]),
                f"{score['days_to_ripe']['coverage']:.2f}",
                f"{score['days_to_ripe']['median_abs_error_days']:.2f} d",
                f"{score['days_to_ripe']['median_width_days']:.1f} d",
            ]
            for condition, score in each.items()
        ],
    )


def _confusion_table(condition: Condition, rows: Sequence[Judged]) -> Table:
    counts = confusion(rows)
    return Table(
        title=f"{condition[0]}, {condition[1]}, aging: true stage (rows) against ours",
        columns=("", *STAGES),
        rows=[[stage, *map(str, counts[k].tolist())] for k, stage in enumerate(STAGES)],
    )


def _figure16_table(found: Mapping[Condition, Sequence[Felt]]) -> Table:
    rows = []
    for gripper, days in _ripened(found).items():
        cells = [f"{mean:.1f} ± {sd:.1f}" for mean, sd in days]
        rows.append([gripper, "not printed", *cells])
    return Table(
        title="Figure 16: settled change at one width (rigid) or pressure (soft) over days, %, "
        "mean ± sd over the fruits that ripened in this time",
        columns=("gripper", "published", *(f"day {day + 1}" for day in range(DAYS))),
        rows=rows,
    )


def _ripened(
    found: Mapping[Condition, Sequence[Felt]],
) -> dict[str, list[tuple[float, float]]]:
    """Return mean and sd of the settled change on each day, of fruit hard at first, ripe at last.

    Each fruit's own mean is put to that of all: sizes and sensors differ by more than days do.
    """
    changes: dict[str, list[tuple[float, float]]] = {}
    for (level, gripper, aging), stations in found.items():
        if level != "paper" or not aging:
            continue
        curves = [
            [felt.as_published[f"fruit-{number}", day] for day in range(DAYS)]
            for felt in stations
            for number, fruit in enumerate(felt.others)
            if fruit.stage(0) in STAGES[:2] and fruit.stage(DAYS - 1) in STAGES[2:]
        ]
        if curves:
            each = np.array(curves)
            moved = each - each.mean(axis=1, keepdims=True) + each.mean()
            changes[gripper] = [(float(day.mean()), float(day.std())) for day in moved.T]
    return changes


def _figure16(found: Mapping[Condition, Sequence[Felt]]) -> Figure:
    from palpate.plots.ripeness_study import figure16

    return figure16(_ripened(found))


def _figure(
    each: Mapping[Condition, Mapping[str, Any]], rows: Mapping[Condition, Sequence[Judged]]
) -> Figure:
    from palpate.plots.ripeness_study import study_figure

    accuracy = {
        " ".join((level, gripper, "aging" if aging else "not aging")): {
            way: None if score[way] is None else 100 * score[way]["exact"] for way in WAYS
        }
        for (level, gripper, aging), score in each.items()
    }
    waits = {
        f"{level}, {gripper}": np.array(
            [
                (row.wait_days, row.value_days, row.low_days, row.high_days)
                for row in rows[level, gripper, aging]
                if row.wait_days > 0
            ]
        )
        for level, gripper, aging in rows
        if level == "paper" and aging
    }
    return study_figure(accuracy, waits)
