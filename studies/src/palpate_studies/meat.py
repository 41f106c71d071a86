"""Squeezes of meat: real double presses of a plant-based steak, with a sheet's error added.

The steak is the only meat with published curves. Age and doneness are not recorded. The curves show
how much specimens of one steak differ, and so how large a change a squeeze can detect.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.holds.strict import Kind, read_table
from palpate_studies.report import StudyReport, Table, as_command

#: Scatter of ln stiffness from grasp to grasp, due to the sheet on the twin's fruit as in
#: `ripeness_virtual`; and grasps averaged per specimen.
SHEET_SD, GRASPS = 0.25 * 2.0 / 3.0, 3
#: Relative falls of the force to detect. Warner-Bratzler shear of beef falls by about 30 % in two
#: weeks of aging: an order of magnitude, not a result of this study.
FALLS = (0.3, 0.5)
#: Sum of the one-sided normal quantiles for 5 % false alarms and 20 % misses.
_QUANTILES = 1.645 + 0.842
_COLUMNS: dict[str, Kind] = {
    "curve": "text",
    "test": "text",
    "direction": "text",
    "leg": "number",
    "force_n": "number",
}


def report(
    *,
    presses: Annotated[
        Path, typer.Option(help="food_double_presses.csv.gz.", metavar="CSV", exists=True)
    ],
) -> StudyReport:
    """Measure the spread of specimens of one plant-based steak, and the detectable change.

    Example: palpate study meat --presses food_double_presses.csv.gz
    """
    return judge(read_presses(presses))


command = as_command(report)


def read_presses(path: Path) -> list[dict[str, Any]]:
    """Return one row per double press: duration, direction and ln of the first peak."""
    table = read_table(path, columns=_COLUMNS)
    names, first, curve = np.unique(
        table["curve"].astype(str), return_index=True, return_inverse=True
    )
    return [
        {
            "speed": str(table["test"][row]).removeprefix("double "),
            "direction": str(table["direction"][row]),
            "ln_force": math.log(table["force_n"][(curve == k) & (table["leg"] == 1)].max()),
        }
        for k, row in zip(range(len(names)), first, strict=True)
    ]


def judge(rows: list[dict[str, Any]]) -> StudyReport:
    """Report scatter and required specimens, with a row per speed."""
    summary = []
    for speed in sorted({row["speed"] for row in rows}, key=lambda text: float(text.split()[0])):
        mine = [row for row in rows if row["speed"] == speed]
        scatter = math.sqrt(
            np.mean(
                [
                    np.var([r["ln_force"] for r in mine if r["direction"] == direction], ddof=1)
                    for direction in sorted({row["direction"] for row in mine})
                ]
            )
        )
        by_sheet = math.hypot(scatter, SHEET_SD / math.sqrt(GRASPS))
        summary.append(
            {
                "speed": speed,
                "presses": len(mine),
                "force_n": math.exp(float(np.median([row["ln_force"] for row in mine]))),
                "sd": scatter,
                **{f"needed_{100 * fall:.0f}": _count_needed(by_sheet, fall) for fall in FALLS},
            }
        )
    return StudyReport(
        name="meat",
        title="Meat: change that a squeeze can detect (real curves, sheet error added)",
        provenance=(
            "Real: double presses of a plant-based steak to half its thickness, along and across "
            "its grain, with a load cell.",
            f"`needed`: specimens in each of two groups, {GRASPS} grasps each, to detect a fall of "
            "the force with 5 % false alarms and 20 % misses. The sheet adds a scatter of "
            f"{SHEET_SD:.2f} (ln) per grasp, as on the twin. Age, doneness and disease are not "
            "known for any curve.",
        ),
        tables=[Table.of("By the duration of a press", summary)],
        payload={"origin": "real", "summary": summary},
    )


def _count_needed(sd: float, fall: float) -> int:
    """Return the specimens per group needed to detect a fall.

    >>> _count_needed(0.4, 0.3)
    16
    """
    return math.ceil(2.0 * (_QUANTILES * sd / math.log(1.0 - fall)) ** 2)
