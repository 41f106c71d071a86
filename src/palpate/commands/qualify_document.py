"""A qualification as the JSON document that the command prints, and as rows for tables."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.produce.qualify.agreement import Agreement, Demand, Effort


def qualification_document(
    found: Agreement, effort: Effort, demand: Demand, *, unit: str, items: int, pairs: int
) -> dict[str, object]:
    """Return the JSON of a qualification; null for what can't be had."""
    from palpate.produce.qualify.agreement import confusion_of

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
        "confusion": confusion_of(found, demand.limits).tolist(),
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


def grade_names(limits: list[float]) -> list[str]:
    """Return the names of the grades between limits.

    >>> grade_names([12.0, 14.0])
    ['below 12', '12 to 14', '14 and above']
    """
    between = [f"{low:g} to {high:g}" for low, high in pairwise(limits)]
    return [f"below {limits[0]:g}", *between, f"{limits[-1]:g} and above"]
