"""Table 6 of the paper: an apple before and after its fall, free or supported."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from palpate.commands.options import JsonOption
from palpate_studies.bruise_table6 import (
    COLUMNS,
    DROPPED,
    FIRST_SENSOR,
    PUBLISHED,
    REPEATS,
    ROWS,
    SENSORS,
    Table6,
    grasped,
    summary,
    supported,
    table,
)
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.twin_session import LEVELS

#: Variants of what lies between the fingers.
VARIANTS = {"free": grasped, "supported": supported}


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Grasp a simulated apple before and after its fall, free and held in place by a support.

    Example: palpate study table6 --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Make the grasps and compare the changes with the published ones."""
    made = {
        variant: {
            level: [
                make(level, FIRST_SENSOR + sensor, repeats=repeats) for sensor in range(sensors)
            ]
            for level in LEVELS
        }
        for variant, make in VARIANTS.items()
    }
    met = {
        variant: {level: within(each[level]) for level in LEVELS} for variant, each in made.items()
    }
    support_n = {
        level: float(np.median([one.support_n for one in made["supported"][level]]))
        for level in LEVELS
    }
    return StudyReport(
        name="table6",
        title="Table 6: an apple before and after its fall",
        provenance=[
            f"Simulated: {repeats} grasps of one apple at one width on each of {sensors} sensors "
            "per level; median sensor's mean ± sd (range of means).",
            "Published: one apple, one sensor, 10 grasps; width not printed.",
            "Free: both fingers carry one force. Supported: what the apple rests on holds it in "
            "place, so that each finger presses its own side. Inputs of the twin, set on other "
            f"sensors with a free apple: the width, by 'before', and a dent of {DROPPED.dent_mm:g} "
            "mm, by 'after'; nothing was set again for the support.",
            "Force that the support has to take up: "
            + ", ".join(f"{support_n[level]:.1f} N ({level})" for level in LEVELS)
            + "; an apple of 200 g that slides at 0.5 takes up 1 N.",
        ],
        tables=[
            *(_titled(table(each), variant) for variant, each in made.items()),
            _met_table(met),
        ],
        payload={
            "study": "table6",
            "origin": "twin",
            "support_n": support_n,
            "published": {row: [list(pair) for pair in pairs] for row, pairs in PUBLISHED.items()},
            "met": met,
            "table6": {
                variant: {
                    level: {
                        row: {column: summary(each[level], row, column) for column in COLUMNS}
                        for row in ROWS
                    }
                    for level in LEVELS
                }
                for variant, each in made.items()
            },
        },
    )


def within(made: list[Table6]) -> dict[str, dict[str, Any]]:
    """Return for every published entry the median sensor's mean, and whether it is met.

    It is met where the difference of the means is below twice the published sd.
    """
    found = dict[str, dict[str, Any]]()
    for row, pairs in PUBLISHED.items():
        for column, (mean, sd) in zip(COLUMNS, pairs, strict=True):
            values = summary(made, row, column)
            ours = float(np.median(values["mean"]))
            found[f"{row}, {column}"] = {
                "mean": ours,
                "sd": float(np.median(values["sd"])),
                "published": mean,
                "met": abs(ours - mean) <= 2.0 * sd,
            }
    return found


def _titled(made: Table, variant: str) -> Table:
    return Table(title=f"{variant}: {made.title}", columns=made.columns, rows=made.rows)


def _met_table(met: Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]) -> Table:
    return Table(
        title="Within twice the published sd",
        columns=("apple", "level", "entries", "met", "missed"),
        rows=[
            [
                variant,
                level,
                str(len(found)),
                str(sum(one["met"] for one in found.values())),
                "; ".join(name for name, one in found.items() if not one["met"]) or "-",
            ]
            for variant, each in met.items()
            for level, found in each.items()
        ],
    )
