"""`palpate qualify`: agreement with a reference instrument, and its ceiling."""

from __future__ import annotations

from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.cli.options import JsonOption, StoreOption, opt
from palpate.cli.output import finite_or_none, print_json, print_message
from palpate.errors import InputError
from palpate.files import atomic_path, check_new
from palpate.terminal_table import make_console, print_table
from palpate_station.cli.items import open_store
from palpate_station.plots.inline_svg import inline_svg
from palpate_station.plots.qualify import differences_figure, readings_figure
from palpate_station.plots.report_page import PageTable, Part, render_page
from palpate_station.qualify.agreement import (
    FIGURES,
    Agreement,
    Demand,
    Effort,
    count_grades,
    estimate_effort,
    measure_agreement,
)
from palpate_station.qualify.conversion import CONVERTIBLE, Conversion
from palpate_station.qualify.readings import read_pairs, read_pairs_with_store
from palpate_station.qualify.scatter import default_tolerance, estimate_scatter


def qualify(
    readings: Annotated[
        Path,
        typer.Argument(
            help="Table (CSV, Parquet or Excel) with columns item_id, side, reference, grasp.",
            metavar="FILE",
        ),
    ],
    tolerance: Annotated[
        float | None,
        opt(
            "--tolerance",
            "Accepted difference, in the reference's unit. [default: the reference's "
            "repeatability on one item]",
            min=1e-9,
        ),
    ] = None,
    limit: Annotated[
        list[float] | None,
        opt("--limit", "Limit between two grades, in the reference's unit; repeat for more."),
    ] = None,
    cost: Annotated[
        tuple[float, float] | None,
        opt(
            "--cost HIGH LOW",
            "With --limit: cost of grading an item one grade too high, and too low. [default: 1 1]",
        ),
    ] = None,
    unit: Annotated[str, opt("--unit", "Unit of the reference, for display.")] = "",
    grasp_s: Annotated[float, opt("--grasp-s SECONDS", "Time of one grasp.", min=0.0)] = 15.0,
    handling_s: Annotated[
        float, opt("--handling-s", "Handling time per item, without grasps.", min=0.0)
    ] = 5.0,
    level: Annotated[
        float, opt("--level", "Confidence level of the intervals.", min=0.5, max=0.999)
    ] = 0.9,
    report: Annotated[
        Path | None, opt("--report FILE.html", "Also write a printable report.")
    ] = None,
    measurement: Annotated[
        str | None,
        opt(
            "--measurement NAME",
            "Take the grasps from the store: firmness, stiffness_n_per_mm ...; FILE then has no "
            "column grasp.",
        ),
    ] = None,
    store: StoreOption = None,
    save: Annotated[
        Path | None,
        opt(
            "--save FILE.json",
            "With --measurement: write the line to the reference's unit, for `palpate serve "
            "--reference`.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Qualify grasps against a penetrometer, a durometer or a buyer's grades.

    The table has one row per side; rows of the same item have the same item_id. The ceiling is
    known only if the reference was read at least twice on some items.

    Example: palpate qualify readings.csv --tolerance 1 --unit lbf --limit 13 --report page.html
    """
    limits = tuple(limit or ())
    if any(later <= earlier for earlier, later in pairwise(limits)):
        raise InputError(f"--limit {limits[-1]:g}: give the limits in increasing order")
    if cost is not None and not limits:
        raise InputError("--cost requires --limit: costs are those of wrong grades")
    cost_high, cost_low = cost or (1.0, 1.0)
    if min(cost_high, cost_low) < 0:
        raise InputError(f"--cost {cost_high:g} {cost_low:g}: costs must not be negative")
    if report is not None:
        check_new(report, option="--report")
    if measurement is None:
        if save is not None:
            raise InputError("--save requires --measurement, which names what is converted")
        pairs, simulated = read_pairs(readings), False
    else:
        if measurement not in CONVERTIBLE:
            raise InputError(f"--measurement {measurement}: use one of {', '.join(CONVERTIBLE)}")
        with open_store(store) as opened:
            pairs, simulated = read_pairs_with_store(readings, opened, measurement=measurement)
    if save is not None:
        if not unit:
            raise InputError("--save requires --unit, the unit of the answers")
        check_new(save, option="--save")
    for name, values in (("reference", pairs.reference), ("grasp", pairs.grasp)):
        if np.ptp(values[pairs.has_both]) == 0:
            raise InputError(f"{readings}: all readings of the {name} are equal")
    if tolerance is None:
        tolerance = default_tolerance(estimate_scatter(pairs.reference, pairs.item))
    demand = Demand(
        tolerance=tolerance, limits=limits, level=level, cost_high=cost_high, cost_low=cost_low
    )
    found = measure_agreement(pairs, demand)
    effort = estimate_effort(found, demand, grasp_s=grasp_s, handling_s=handling_s)
    document = qualification_document(
        found, effort, demand, unit=unit, items=pairs.items, pairs=int(pairs.has_both.sum())
    )
    if report is not None:
        write_report(report, document, found=found, source=readings.name)
        print_message(f"Written: {report}")
    if as_json:
        print_json(document)
    else:
        print_qualification(document)
    # Last, because the table shows why there is no relation.
    if save is not None and measurement is not None:
        if not found.is_related:
            raise InputError(f"--save {save}: {relation_text(document)}")
        Conversion.from_agreement(
            found, pairs, measurement=measurement, unit=unit, simulated=simulated
        ).save(save)
        print_message(f"Written: {save}")


#: As `qualification_document` returns it.
Document = dict[str, Any]


def qualification_document(
    agreement: Agreement, effort: Effort, demand: Demand, *, unit: str, items: int, pairs: int
) -> Document:
    """Return the JSON of a qualification, with null for unknown values."""
    return {
        "items": items,
        "pairs": pairs,
        "unit": unit or None,
        "level": demand.level,
        "tolerance": demand.tolerance,
        "limits": list(demand.limits),
        "figures": {
            name: {end: finite_or_none(getattr(figure, end)) for end in ("value", "low", "high")}
            for name, figure in agreement.figures.items()
        },
        "related": agreement.is_related,
        "correlation": {
            end: finite_or_none(getattr(agreement.correlation, end))
            for end in ("value", "low", "high")
        },
        "line": {"slope": agreement.slope, "offset": agreement.offset}
        if agreement.is_related
        else None,
        "scatter": {
            name: {end: finite_or_none(getattr(scatter, end)) for end in ("between", "within")}
            for name, scatter in (("reference", agreement.reference), ("grasp", agreement.grasp))
        },
        "confusion": count_grades(
            agreement, demand.limits if agreement.is_related else ()
        ).tolist(),
        "reference_readings_needed": effort.reference_readings,
        "grasps_needed": effort.grasps,
        "mismatch": finite_or_none(effort.mismatch),
        "items_per_hour": effort.items_per_hour,
        "items_to_test": effort.items_to_test,
    }


def print_qualification(document: Document) -> None:
    """Print a qualification as tables: agreement, grades, effort."""
    console = make_console()
    console.print(f"{document['items']} items, {document['pairs']} paired readings")
    if not document["related"]:
        console.print(relation_text(document))
    columns = ("agreement", ">value", f">{100 * document['level']:.0f} % interval")
    print_table(columns, figure_rows(document), console=console)
    if document["confusion"]:
        console.print()
        print_table(*grade_table(document), console=console)
    console.print()
    print_table(("effort", ">answer"), effort_rows(document), console=console)


def relation_text(document: Document) -> str:
    """Return the sentence of a qualification without a relation."""
    found, level = document["correlation"], f"{100 * document['level']:.0f} %"
    return (
        "no relation between grasp and reference: correlation of the items "
        f"{found['value']:.2f} ({level} interval {found['low']:.2f} to {found['high']:.2f}); "
        "grasps can't be converted to the reference"
    )


def figure_rows(document: Document) -> list[tuple[str, str, str]]:
    """Return table rows of quantity, value with unit, and interval."""
    unit = f" {document['unit']}" if document["unit"] else ""
    rows = []
    for name, figure in document["figures"].items():
        if not document["related"] and figure["value"] is None:
            rows.append((FIGURES[name], "no relation", ""))
            continue
        value, low, high = figure["value"], figure["low"], figure["high"]
        if value is None:
            rows.append((FIGURES[name], "not known", ""))
        elif name == "limit_of_agreement":
            rows.append((FIGURES[name], f"{value:.2f}{unit}", f"{low:.2f} to {high:.2f}"))
        elif name.startswith(("r_squared", "cost")):
            rows.append((FIGURES[name], f"{value:.2f}", f"{low:.2f} to {high:.2f}"))
        else:
            rows.append(
                (FIGURES[name], f"{100 * value:.0f} %", f"{100 * low:.0f} to {100 * high:.0f} %")
            )
    return rows


def effort_rows(document: Document) -> list[tuple[str, str]]:
    """Return table rows of the effort required for the tolerance."""
    unit = f" {document['unit']}" if document["unit"] else ""
    per_hour = document["items_per_hour"]
    return [
        (
            f"reference readings to average for an error within {document['tolerance']:.3g}{unit} "
            f"in {100 * document['level']:.0f} % of items",
            format_count(document, "reference"),
        ),
        ("grasps to average for the same error", format_count(document, "grasp")),
        ("items per hour at that number of grasps", "-" if per_hour is None else f"{per_hour:.0f}"),
        (
            "items needed for limits of agreement within half of that",
            "no relation" if document["items_to_test"] is None else f"{document['items_to_test']}",
        ),
    ]


def format_count(document: Document, instrument: str) -> str:
    """Format the number of readings or grasps needed, or the reason why it is unknown."""
    if instrument == "grasp" and not document["related"]:
        return "no relation"
    if document["scatter"][instrument]["within"] is None:
        return "not known: no item was read twice"
    needed = document["grasps_needed" if instrument == "grasp" else "reference_readings_needed"]
    return "not achievable" if needed is None else f"{needed}"


def grade_table(document: Document) -> tuple[list[str], list[list[str]]]:
    """Return columns and rows of the confusion table of grades, reference by grasp."""
    limits = document["limits"]
    between = [f"{low:g} to {high:g}" for low, high in pairwise(limits)]
    grades = [f"below {limits[0]:g}", *between, f"{limits[-1]:g} and above"]
    counts = zip(grades, document["confusion"], strict=True)
    columns = ["reference \\ grasp", *(f">{grade}" for grade in grades)]
    return columns, [[grade, *map(str, row)] for grade, row in counts]


def write_report(path: Path, document: Document, *, found: Agreement, source: str) -> None:
    """Write a qualification report as one self-contained HTML page.

    `found`: the agreement with its pairs, for the figures.
    `source`: name of the table of readings.
    Raises `MissingExtraError` if matplotlib is not installed.
    """
    unit = f" ({document['unit']})" if document["unit"] else ""
    shown = {}
    if found.is_related:  # both figures show converted grasps
        shown = {
            "Grasp against reference": readings_figure(found, unit=unit),
            "Difference over mean (Bland-Altman)": differences_figure(found, unit=unit),
        }
    body: list[Part] = [
        _tiles(document),
        [(name, inline_svg(figure, label=name)) for name, figure in shown.items()],
        PageTable(
            "Agreement",
            ["figure", ">value", f">{100 * document['level']:.0f} % interval"],
            figure_rows(document),
        ),
        PageTable("Effort", ["question", ">answer"], effort_rows(document)),
    ]
    if document["confusion"]:
        body.append(PageTable("Grades, number of readings", *grade_table(document)))
    body.append(PageTable("Accepted", ["date", "name", "signature"], [["\xa0", "", ""]] * 2))
    text = render_page(
        title="Qualification",
        chips=[
            source,
            *([] if document["related"] else [relation_text(document)]),
            f"{document['items']} items",
            f"{document['pairs']} pairs",
            f"tolerance {document['tolerance']:.3g} {document['unit'] or ''}",
            f"{datetime.now().astimezone():%Y-%m-%d}",
        ],
        simulated=False,
        body=body,
        foot="Grasps are converted to the reference's unit with a line fitted to the other items. "
        "Intervals are from a bootstrap over items. Sides of one item count as repeated readings.",
    )
    with atomic_path(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _tiles(document: Document) -> dict[str, tuple[str, str, str]]:
    found = document["figures"]
    unit = str(document["unit"] or "")

    def percent(name: str) -> str:
        value = found[name]["value"]
        return "not known" if value is None else f"{100 * value:.0f}\xa0%"

    per_hour, ceiling = document["items_per_hour"], found["r_squared_ceiling"]["value"]
    return {
        f"Within {document['tolerance']:.3g} {unit}".strip(): (
            percent("share_within"),
            "",
            f"error-free: {percent('share_within_ceiling')}",
        ),
        "R squared": (
            f"{found['r_squared']['value']:.2f}",
            "",
            "ceiling " + ("not known" if ceiling is None else f"{ceiling:.2f}"),
        ),
        "Grasps needed": (
            format_count(document, "grasp"),
            "",
            "" if per_hour is None else f"{per_hour:.0f} items per hour",
        ),
    }
