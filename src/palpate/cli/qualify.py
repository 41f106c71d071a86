"""`palpate qualify`: agreement with a reference instrument, and the ceiling that it sets."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from palpate.cli.options import JsonOption
from palpate.cli.output import print_json
from palpate.cli.qualify_report import (
    demands_of,
    grade_table,
    qualification_document,
    rows_of,
    write_report,
)
from palpate.errors import InputError
from palpate.produce.qualify.agreement import Demand, agreement_of, effort_of
from palpate.produce.qualify.readings import read_pairs
from palpate.produce.qualify.scatter import scatter_of
from palpate.terminal_table import print_table

#: Without a reference read twice, the tolerance is this share of its scatter over items (guess).
_TOLERANCE_SHARE = 0.5


def qualify(
    readings: Annotated[
        Path,
        typer.Argument(help="Table with columns item_id, side, reference, grasp.", metavar="FILE"),
    ],
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Difference that is accepted, in the reference's unit. [default: the reference's "
            "own scatter on one item]",
            min=1e-9,
            show_default=False,
        ),
    ] = None,
    limit: Annotated[
        list[float] | None,
        typer.Option(help="Limit between two grades, in the reference's unit; repeat for more."),
    ] = None,
    unit: Annotated[str, typer.Option(help="Unit of the reference, for tables.")] = "",
    grasp_s: Annotated[
        float, typer.Option(help="Time of one grasp.", min=0.0, metavar="SECONDS")
    ] = 15.0,
    handling_s: Annotated[
        float, typer.Option(help="Time of an item apart from its grasps.", min=0.0)
    ] = 5.0,
    level: Annotated[
        float, typer.Option(help="Probability of the intervals.", min=0.5, max=0.999)
    ] = 0.9,
    report: Annotated[
        Path | None,
        typer.Option(help="Also write a page to print and sign.", metavar="FILE.html"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Qualify grasps against a penetrometer, a durometer or a buyer's grades.

    Readings of one item repeat its item_id, a row for each side. Without a second reading of
    the reference on some items, the ceiling is not known.

    Example: palpate qualify readings.csv --tolerance 1 --unit lbf --limit 13 --report page.html
    """
    limits = tuple(limit or ())
    if any(later <= earlier for earlier, later in pairwise(limits)):
        raise InputError(f"--limit {limits[-1]:g}: give the limits in rising order")
    if report is not None and report.exists():
        raise InputError(f"--report {report}: exists already and is not overwritten")
    pairs = read_pairs(readings)
    if tolerance is None:
        scatter = scatter_of(pairs.reference, pairs.item)
        tolerance = scatter.within
        if not tolerance > 0:
            tolerance = _TOLERANCE_SHARE * scatter.between
        if not tolerance > 0:
            raise InputError(f"{readings}: the reference reads the same everywhere")
    demand = Demand(tolerance=tolerance, limits=limits, level=level)
    found = agreement_of(pairs, demand)
    effort = effort_of(found, demand, grasp_s=grasp_s, handling_s=handling_s)
    document = qualification_document(
        found, effort, demand, unit=unit, items=pairs.items, pairs=int(pairs.paired.sum())
    )
    if report is not None:
        write_report(report, document, found=found, source=readings.name)
        print(f"palpate qualify: wrote {report}", file=sys.stderr)
    if as_json:
        print_json(document)
        return
    console = Console(highlight=False)
    console.print(f"{document['items']} items, {document['pairs']} paired readings")
    columns = ("agreement", ">value", f">{100 * level:.0f} % interval")
    print_table(columns, rows_of(document), console=console)
    if limits:
        console.print()
        print_table(*grade_table(document), console=console)
    console.print()
    print_table(("effort", ">answer"), demands_of(document), console=console)
