"""The page of a qualification: figures, tables, and a place to sign."""

from __future__ import annotations

from pathlib import Path

from palpate.commands.qualify_document import count_text, demands_of, grade_names, rows_of
from palpate.commands.report_html import Tile, figures, html_page, table, tiles
from palpate.files import atomic_path
from palpate.plots.inline_svg import inline_svg
from palpate.plots.qualify import differences_figure, readings_figure
from palpate.produce.qualify.agreement import Agreement


def write_report(path: Path, document: dict[str, object], *, found: Agreement, source: str) -> None:
    """Write the page of a qualification; it needs no other file.

    Parameters
    ----------
    path : path
        New HTML file.
    document : dict
        As `qualification_document` returns it.
    found : Agreement
        The same, with its pairs for the figures.
    source : str
        Name of the table.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    unit = f" ({document['unit']})" if document["unit"] else ""
    shown = {
        "Grasp against reference": readings_figure(found, unit=unit),
        "Difference over the mean (Bland and Altman)": differences_figure(found, unit=unit),
    }
    body = [
        tiles(_tiles(document)),
        figures([(name, inline_svg(figure, label=name)) for name, figure in shown.items()]),
        table("Agreement", ["figure", ">value", ">interval"], rows_of(document)),
        table("Effort", ["question", ">answer"], demands_of(document)),
    ]
    limits, confusion = document["limits"], document["confusion"]
    assert isinstance(limits, list)
    assert isinstance(confusion, list)
    if limits:
        grades = grade_names(limits)
        rows = [[grade, *map(str, counts)] for grade, counts in zip(grades, confusion, strict=True)]
        columns = ["reference \\ grasp", *(f">{grade}" for grade in grades)]
        body.append(table("Grades", columns, rows))
    body.append(table("Accepted", ["date", "name", "signature"], [["\xa0", "", ""]] * 2))
    text = html_page(
        title="Qualification",
        chips=[source, f"{document['items']} items", f"{document['pairs']} pairs"],
        simulated=False,
        body=body,
        foot="Grasps are converted to the reference's unit by the line of the other items. "
        "Intervals are by the bootstrap over items.",
    )
    with atomic_path(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _tiles(document: dict[str, object]) -> list[Tile]:
    found = document["figures"]
    assert isinstance(found, dict)
    unit = str(document["unit"] or "")

    def percent(name: str) -> str:
        value = found[name]["value"]
        return "not known" if value is None else f"{100 * value:.0f} %"

    hour = document["items_per_hour"]
    return [
        Tile(
            name=f"Within {document['tolerance']:.3g} {unit}".strip(),
            value=percent("share_within"),
            below=f"an instrument without error: {percent('share_within_ceiling')}",
        ),
        Tile(
            name="R squared",
            value=f"{found['r_squared']['value']:.2f}",
            below="ceiling "
            + (
                "not known"
                if found["r_squared_ceiling"]["value"] is None
                else f"{found['r_squared_ceiling']['value']:.2f}"
            ),
        ),
        Tile(
            name="Grasps needed",
            value=count_text(document, "grasp"),
            below="" if hour is None else f"{hour:.0f} items an hour",
        ),
    ]
