"""Compare seeded grasps of the present code with stored ones: `python -m tests.acceptance --help`.

The exit status is 1 if a quantity is certainly worse by more than its tolerance.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from tests.acceptance.grasps import GRASPS_PER_SHEET, SHEETS, list_cases
from tests.acceptance.rows import (
    BASELINE,
    Row,
    measure_grasps,
    read_rows,
    round_row,
    target_of,
    write_rows,
)
from tests.acceptance.table import FEWEST_SHEETS, HEADER, compare_rows

from palpate.terminal_table import make_console, make_table


def report(before: Sequence[Row], after: Sequence[Row]) -> int:
    """Print the tables; return how many quantities are clearly worse."""
    console = make_console()
    comparisons = compare_rows(before, after)
    for part, found in groupby(comparisons, key=lambda one: one.part):
        console.print(f"\n{part}", style="bold")
        console.print(make_table(HEADER, [one.cells() for one in found]))
    failed = [f"{one.quantity.name} ({one.part})" for one in comparisons if one.is_clearly_worse]
    changed = sum(old != new for old, new in zip(map(str, before), map(str, after), strict=True))
    console.print(f"\n{changed} of {len(after)} grasps changed.")
    if failed:
        console.print(f"Clearly worse: {', '.join(failed)}.")
    return len(failed)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the report; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.acceptance", description=__doc__)
    most = GRASPS_PER_SHEET * SHEETS
    parser.add_argument(
        "--grasps",
        type=int,
        default=most,
        metavar="N",
        help=f"the first N only, {GRASPS_PER_SHEET} for each sensor; fewer than {FEWEST_SHEETS} "
        "sensors decide nothing",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count(),
        metavar="N",
        help="processes; default: processors",
    )
    parser.add_argument("--baseline", type=Path, default=BASELINE, metavar="FILE")
    parser.add_argument(
        "--write-baseline", action="store_true", help="store the present code's grasps"
    )
    given = parser.parse_args(arguments)
    cases = list_cases(given.grasps)
    if given.write_baseline:
        write_rows(measure_grasps(cases, jobs=given.jobs), given.baseline)
        return 0
    stored = {_key(row.seed, row.task, row.target_n): row for row in read_rows(given.baseline)}
    keys = [_key(case.seed, case.task, target_of(case)) for case in cases]
    if missing := [key for key in keys if key not in stored]:
        parser.error(
            f"{given.baseline} has no grasp {', '.join(missing[0])}; store the grasps of the old "
            "code with --write-baseline"
        )
    after = [round_row(row) for row in measure_grasps(cases, jobs=given.jobs)]
    return int(report([stored[key] for key in keys], after) > 0)


def _key(seed: int, task: str, target_n: float) -> tuple[str, str, str]:
    """Return what identifies a grasp in a changed list of cases."""
    return str(seed), task, f"{target_n:.3g} N"


if __name__ == "__main__":
    sys.exit(main())
