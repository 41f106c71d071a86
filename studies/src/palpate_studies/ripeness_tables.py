"""Tables of the study `ripeness`: how often each way is right, where it errs, days, Figure 16."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from palpate.produce.ripeness.stages import STAGES
from palpate.twin.ranges import Level
from palpate.twin.world import GripperKind
from palpate_studies.report import Table
from palpate_studies.ripeness_felt import Felt
from palpate_studies.ripeness_scores import MARGINS, WAYS, Judged, confusion
from palpate_studies.ripeness_station import DAYS

#: Level, gripper and whether the sensor ages: what is compared.
Condition: TypeAlias = tuple[Level, GripperKind, bool]


def named(condition: Condition) -> str:
    """Return a condition in words."""
    level, gripper, aging = condition
    return f"{level}, {gripper}, {'aging' if aging else 'not aging'}"


def _cells(condition: Condition) -> list[str]:
    level, gripper, aging = condition
    return [level, gripper, "on" if aging else "off"]


def accuracy_table(each: Mapping[Condition, Mapping[str, Any]]) -> Table:
    """Return a table of how often each way was right."""

    def cell(score: Mapping[str, float] | None) -> str:
        if score is None:
            return "-"
        return f"{100 * score['exact']:.1f} / {100 * score['within_one']:.1f}"

    return Table(
        title="Stage of four: exact / within one, % of fruit days",
        columns=("level", "gripper", "aging", "fruit days", "grasps a day", *WAYS),
        rows=[
            [
                *_cells(condition),
                str(score["fruit_days"]),
                f"{score['grasps_a_day']:.1f}",
                *(cell(score[way]) for way in WAYS),
            ]
            for condition, score in each.items()
        ],
    )


def compared_table(each: Mapping[Condition, Sequence[Mapping[str, Any]]]) -> Table:
    """Return a table of the wrong stages of ours less those of every other way."""
    return Table(
        title="Wrong stages: ours less the other way, points (90 % over fruits)",
        columns=("level", "gripper", "aging", "other way", "difference", "who errs less"),
        rows=[
            [
                *_cells(condition),
                one["rival"],
                "{:+.1f} ({:+.1f} to {:+.1f})".format(
                    *(100 * one[key] for key in ("difference", "low", "high"))
                ),
                one["verdict"].replace("rival", "the other way"),
            ]
            for condition, rows in each.items()
            for one in rows
        ],
    )


def sensors_table(by_sensor: Mapping[Condition, Sequence[float]]) -> Table:
    """Return a table of how often ours was right on each sensor."""
    return Table(
        title="Ours, exact, %, sensor by sensor",
        columns=("level", "gripper", "aging", "sensors"),
        rows=[
            [*_cells(condition), ", ".join(f"{100 * one:.1f}" for one in shares)]
            for condition, shares in by_sensor.items()
        ],
    )


def limits_table(each: Mapping[Condition, Mapping[str, Any]]) -> Table:
    """Return a table of where ours errs, and what a measurement without error would reach."""
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
        rows.append([*_cells(condition), f"{100 * score['possible']:.1f}", *cells])
    return Table(
        title="Exact, %, by how far the force at 1 mm is from a boundary; (what "
        "as many grasps that day would reach if they measured without any error)",
        columns=("level", "gripper", "aging", "possible, all", *spans),
        rows=rows,
    )


def days_table(each: Mapping[Condition, Mapping[str, Any]]) -> Table:
    """Return a table of how well the days to ripe were predicted."""
    return Table(
        title="Days to ripe, of fruit not ripe yet; 90 % interval",
        columns=("level", "gripper", "aging", "fruit days", "coverage", "median error", "width"),
        rows=[
            [
                *_cells(condition),
                str(score["days_to_ripe"]["fruit_days"]),
                f"{score['days_to_ripe']['coverage']:.2f}",
                f"{score['days_to_ripe']['median_abs_error_days']:.2f} d",
                f"{score['days_to_ripe']['median_width_days']:.1f} d",
            ]
            for condition, score in each.items()
        ],
    )


def confusion_table(condition: Condition, rows: Sequence[Judged]) -> Table:
    """Count true stages against ours."""
    counts = confusion(rows)
    return Table(
        title=f"{named(condition)}: true stage (rows) against ours",
        columns=("", *STAGES),
        rows=[[stage, *map(str, counts[k].tolist())] for k, stage in enumerate(STAGES)],
    )


def figure16_table(days: Mapping[Condition, Sequence[tuple[float, float]]]) -> Table:
    """Return a table of the settled change over days; the paper prints no such numbers."""
    return Table(
        title="Figure 16: settled change at one width (rigid) or pressure (soft) over days, %, "
        "mean ± sd over the fruits that ripened in this time",
        columns=("condition", "published", *(f"day {day + 1}" for day in range(DAYS))),
        rows=[
            [named(condition), "not printed", *(f"{mean:.1f} ± {sd:.1f}" for mean, sd in values)]
            for condition, values in days.items()
        ],
    )


def ripened(stations: Sequence[Felt]) -> list[tuple[float, float]]:
    """Return mean and sd of the settled change on each day, of fruit hard at first, ripe at last.

    Each fruit's own mean is put to that of all: sizes and sensors differ by more than days do.
    Where no fruit ripened there are none.
    """
    curves = [
        [felt.as_published[f"fruit-{number}", day] for day in range(DAYS)]
        for felt in stations
        for number, fruit in enumerate(felt.others)
        if fruit.stage(0) in STAGES[:2] and fruit.stage(DAYS - 1) in STAGES[2:]
    ]
    if not curves:
        return []
    each = np.array(curves)
    moved = each - each.mean(axis=1, keepdims=True) + each.mean()
    return [(float(day.mean()), float(day.std())) for day in moved.T]
