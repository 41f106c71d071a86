"""`palpate qualify`: agreement with a reference instrument, and the ceiling that it sets."""

from __future__ import annotations

import json
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.commands.options import JsonOption
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.produce.qualify.agreement import Agreement, Demand
    from palpate.produce.qualify.effort import Effort

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
    grasp_s: Annotated[float, typer.Option(help="Time of one grasp.", min=0.0)] = 15.0,
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
    """Qualify grasps against a penetrometer, a durometer or a buyer's grades on the same items.

    Readings of one item repeat its item_id, a row for each side. Without a second reading of the
    reference on some items, the ceiling is not known.

    Example: palpate qualify readings.csv --tolerance 1 --unit lbf --limit 13 --report page.html
    """
    from palpate.produce.qualify.agreement import Demand, agreement_of
    from palpate.produce.qualify.effort import effort_of
    from palpate.produce.qualify.readings import read_pairs
    from palpate.produce.qualify.scatter import scatter_of

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
        from palpate.commands.qualify_report import write_report

        write_report(report, document, found=found, source=readings.name)
        print(f"palpate qualify: wrote {report}", file=sys.stderr)
    if as_json:
        print(json.dumps(document, allow_nan=False, indent=1))
    else:
        _print_table(document)


def qualification_document(
    found: Agreement, effort: Effort, demand: Demand, *, unit: str, items: int, pairs: int
) -> dict[str, object]:
    """Return the JSON of a qualification; null for what can't be had."""

    def known(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "items": items,
        "pairs": pairs,
        "unit": unit or None,
        "level": demand.level,
        "tolerance": demand.tolerance,
        "limits": list(demand.limits),
        "figures": {
            name: {
                "value": known(figure.value),
                "low": known(figure.low),
                "high": known(figure.high),
            }
            for name, figure in found.figures.items()
        },
        "line": {"slope": found.slope, "offset": found.offset},
        "scatter": {
            name: {"between": known(scatter.between), "within": known(scatter.within)}
            for name, scatter in (("reference", found.reference), ("grasp", found.grasp))
        },
        "confusion": found.confusion.astype(int).tolist(),
        "reference_readings_needed": effort.reference_readings,
        "grasps_needed": effort.grasps,
        "mismatch": effort.mismatch,
        "items_per_hour": effort.items_per_hour,
        "items_to_test": effort.items_to_test,
    }


def rows_of(document: dict[str, object]) -> list[tuple[str, str, str]]:
    """Return a qualification as rows: what, value with unit, interval."""
    from palpate.produce.qualify.agreement import FIGURES

    figures = document["figures"]
    assert isinstance(figures, dict)
    unit = f" {document['unit']}" if document["unit"] else ""
    rows = []
    for name, figure in figures.items():
        value, low, high = figure["value"], figure["low"], figure["high"]
        if value is None:
            rows.append((FIGURES[name], "not known", ""))
        elif name == "limit_of_agreement":
            rows.append((FIGURES[name], f"{value:.2f}{unit}", f"{low:.2f} to {high:.2f}"))
        elif name.startswith("r_squared"):
            rows.append((FIGURES[name], f"{value:.2f}", f"{low:.2f} to {high:.2f}"))
        else:
            rows.append(
                (FIGURES[name], f"{100 * value:.0f} %", f"{100 * low:.0f} to {100 * high:.0f} %")
            )
    return rows


def demands_of(document: dict[str, object]) -> list[tuple[str, str]]:
    """Return what a demand costs, as rows."""
    unit = f" {document['unit']}" if document["unit"] else ""
    hour = document["items_per_hour"]
    level = document["level"]
    assert isinstance(level, float)
    return [
        (
            f"readings of the reference that average to within {document['tolerance']:g}{unit} "
            f"in {100 * level:.0f} % of items",
            count_text(document, "reference"),
        ),
        ("grasps that do", count_text(document, "grasp")),
        ("items per hour at that number of grasps", "-" if hour is None else f"{hour:.0f}"),
        (
            "items to test to know the limit of agreement to half that",
            f"{document['items_to_test']}",
        ),
    ]


def count_text(document: dict[str, object], instrument: str) -> str:
    """Return how many readings of the reference or grasps are needed, or why none is known."""
    scatter = document["scatter"]
    assert isinstance(scatter, dict)
    if scatter[instrument]["within"] is None:
        return "not known: no item was read twice"
    needed = document["grasps_needed" if instrument == "grasp" else "reference_readings_needed"]
    return "no number does" if needed is None else f"{needed}"


def _print_table(document: dict[str, object]) -> None:
    from rich.console import Console
    from rich.table import Table

    level = document["level"]
    assert isinstance(level, float)
    console = Console(highlight=False)
    console.print(f"{document['items']} items, {document['pairs']} paired readings")
    table = Table(box=None, header_style="dim", pad_edge=False)
    table.add_column("agreement")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column(f"{100 * level:.0f} % interval", justify="right", no_wrap=True)
    for row in rows_of(document):
        table.add_row(*row)
    console.print(table)
    limits, confusion = document["limits"], document["confusion"]
    assert isinstance(limits, list)
    assert isinstance(confusion, list)
    if limits:
        grades = grade_names(limits)
        table = Table("reference \\ grasp", *grades, box=None, header_style="dim", pad_edge=False)
        for grade, counts in zip(grades, confusion, strict=True):
            table.add_row(grade, *map(str, counts))
        console.print()
        console.print(table)
    console.print()
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column()
    table.add_column(justify="right", no_wrap=True)
    for demand in demands_of(document):
        table.add_row(*demand)
    console.print(table)


def grade_names(limits: list[float]) -> list[str]:
    """Return the names of the grades between limits.

    >>> grade_names([12.0, 14.0])
    ['below 12', '12 to 14', '14 and above']
    """
    between = [f"{low:g} to {high:g}" for low, high in pairwise(limits)]
    return [f"below {limits[0]:g}", *between, f"{limits[-1]:g} and above"]
