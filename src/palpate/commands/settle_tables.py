"""The tables that `palpate settle` prints for people."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.commands.settle_report import Document, by_error
from palpate.settling.evaluate import Prediction, score_predictions

#: How many of the holds furthest off are listed.
ROWS_SHOWN = 10

#: Columns of text where standard output is no terminal that has a width of its own.
PIPED_WIDTH = 120


def print_tables(document: Document, *, level: float, written: Sequence[Path]) -> None:
    """Print the summary, then the holds that the first method missed by most."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    def table(title: str, *headings: str) -> Table:
        view = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
        for place, heading in enumerate(headings):
            first = place == 0
            view.add_column(
                heading,
                justify="left" if first else "right",
                no_wrap=not first,
                overflow="fold",
                min_width=14 if first else None,
            )
        return view

    console = Console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    summary = table(
        f"Value predicted for {document.horizon_s:g} s: |error| in % of the settled value",
        *("method", "cut-off", "holds", "median", "mean", "p90", "of rest", f"in {level:.0%}", "±"),
    )
    for entry in document.summary():
        summary.add_row(*_summary_cells(entry))
    console.print(summary)
    console.print(
        f"[dim]of rest: median |error| in % of the change still to come; in {level:.0%}: share of "
        "holds inside their interval; ±: median half-width in %[/dim]",
        highlight=False,
    )
    for entry in document.summary():
        if "holds_decided" in entry:
            others = entry["holds"] - entry["holds_decided"]
            console.print(
                f"{entry['method']}: ± fell below {entry['until_half_width_percent']:g} % in "
                f"{entry['holds_decided']} of {entry['holds']} holds (median time: "
                f"{_text(entry['median_decision_s'])} s)"
                + ("; the others waited to their end" if others else "")
            )
    counts = Counter(str(row.status) for row in document.predictions)
    console.print("Status: " + ", ".join(f"{n} {status}" for status, n in counts.most_common()))
    rows = [r for r in document.predictions if r.method == document.predictions[0].method]
    order = by_error(rows)[:ROWS_SHOWN]
    every = len(order) == len(rows)
    worst = table(
        f"{'All' if every else 'Furthest off'}, {rows[0].method}",
        *("hold", "cut-off", "predicted", "interval", "settled", "error", "status"),
    )
    for index in sorted(order) if every else order:
        worst.add_row(*_row_cells(rows[index]))
    console.print(worst)
    for path in written:
        console.print(f"Written: {path}", highlight=False, soft_wrap=True)


def _summary_cells(entry: Mapping[str, Any]) -> list[str]:
    cutoff = "-" if entry["cutoff_s"] is None else f"{entry['cutoff_s']:.3g} s"
    if "holds_decided" in entry:
        cutoff = f"~{cutoff}"
    coverage = entry["coverage"]
    return [
        entry["method"],
        cutoff,
        str(entry["holds"]),
        _text(entry["median_abs_error_percent"]),
        _text(entry["mean_abs_error_percent"]),
        _text(entry["p90_abs_error_percent"]),
        _text(entry["median_error_of_remaining_percent"]),
        "-" if coverage is None else f"{coverage:.2f}",
        _text(entry["median_half_width_percent"]),
    ]


def _row_cells(row: Prediction) -> list[str]:
    error_percent = float(score_predictions([row]).error_percent[0])
    return [
        row.hold_id + (f" {row.channel}" if row.channel else ""),
        f"{row.cutoff_s:.3g} s",
        _text(row.predicted, 5),
        f"{_text(row.low, 5)}..{_text(row.high, 5)}" if np.isfinite(row.low) else "-",
        _text(row.settled, 5),
        f"{error_percent:+.2g} %" if np.isfinite(error_percent) else "-",
        str(row.status),
    ]


def _text(figure: float | None, digits: int = 3) -> str:
    return "-" if figure is None or not np.isfinite(figure) else f"{figure:.{digits}g}"
