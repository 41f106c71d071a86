"""Squeezes of meat: the cut from real holds, and the change detectable on a plant-based steak.

Holds of raw meat under an indenter show whether relaxation and stiffness tell the cut. Double
presses of the steak, with a sheet's error added, show how much specimens of one steak differ, and
so how large a change a squeeze can detect. Age and doneness are not recorded.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.errors import InputError
from palpate.holds.strict import Kind, read_table
from palpate_studies.meat_cuts import Part, judge_cuts, read_squeezes
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
        Path | None, typer.Option(help="food_double_presses.csv.gz.", metavar="CSV", exists=True)
    ] = None,
    holds: Annotated[
        Path | None, typer.Option(help="holds_meat.csv.gz.", metavar="CSV", exists=True)
    ] = None,
    tests: Annotated[
        Path | None,
        typer.Option(help="tests_meat.csv.gz: the holds' ramps.", metavar="CSV", exists=True),
    ] = None,
) -> StudyReport:
    """Tell the cut of meat from a squeeze, and measure the spread of specimens.

    Example: palpate study meat --holds holds_meat.csv.gz --tests tests_meat.csv.gz
    """
    if holds is None and (presses is None or tests is not None):
        raise InputError("give --holds FILE or --presses FILE; --tests FILE requires --holds FILE")
    parts = [judge_cuts(read_squeezes(holds, tests))] if holds else []
    parts += [judge_presses(read_presses(presses))] if presses else []
    return StudyReport(
        name="meat",
        title="Meat: the cut, and the change that a squeeze can detect (real curves)",
        provenance=[line for part in parts for line in part[0]],
        tables=[table for part in parts for table in part[1]],
        payload={"origin": "real"} | {key: rows for part in parts for key, rows in part[2].items()},
    )


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


def judge_presses(rows: list[dict[str, Any]]) -> Part:
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
    provenance = [
        "Real: double presses of a plant-based steak to half its thickness, along and across its "
        "grain, with a load cell.",
        f"`needed`: specimens in each of two groups, {GRASPS} grasps each, to detect a fall of the "
        "force with 5 % false alarms and 20 % misses. The sheet adds a scatter of "
        f"{SHEET_SD:.2f} (ln) per grasp, as on the twin. Age, doneness and disease are not known "
        "for any curve.",
    ]
    return provenance, [Table.of("By the duration of a press", summary)], {"summary": summary}


def _count_needed(sd: float, fall: float) -> int:
    """Return the specimens per group needed to detect a fall.

    >>> _count_needed(0.4, 0.3)
    16
    """
    return math.ceil(2.0 * (_QUANTILES * sd / math.log(1.0 - fall)) ** 2)
