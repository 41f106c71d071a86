"""The tables that `palpate settle` prints for people."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.commands.settle_report import by_error
from palpate.settling.score_table import (
    PIPED_WIDTH,
    WIDE,
    ScoreTable,
    empty_table,
    print_scores,
    short,
)
from palpate.settling.scores import Prediction, score_predictions

if TYPE_CHECKING:
    from rich.console import Console

#: How many of the holds furthest off are listed.
ROWS_SHOWN = 10


def print_tables(document: ScoreTable, *, level: float, written: Sequence[Path]) -> None:
    """Print what was predicted; then, where holds reach the horizon, how far off that was."""
    from rich.console import Console

    console = Console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    _print_holds(document, console, level=level)
    counts = Counter(str(row.status) for row in document.predictions)
    by_status = ", ".join(f"{n} {status}" for status, n in counts.most_common())
    console.print(f"Predictions: {by_status}")
    if any(np.isfinite(row.settled) for row in document.predictions):
        print_scores(document.summary(), console, level=level)
    else:
        console.print(
            f"No hold lasts until {document.horizon_s:g} s, so there is nothing to score against."
        )
    for entry in document.summary():
        if "holds_decided" in entry:
            others = entry["holds"] - entry["holds_decided"]
            console.print(
                f"{entry['method']}: ± fell below {entry['until_half_width_percent']:g} % in "
                f"{entry['holds_decided']} of {entry['holds']} holds (median time: "
                f"{short(entry['median_decision_s'])} s)"
                + ("; the others waited to their end" if others else "")
            )
    for path in written:
        console.print(f"Written: {path}", highlight=False, soft_wrap=True)


def _print_holds(document: ScoreTable, console: Console, *, level: float) -> None:
    """Print the holds of the first method, those furthest off or least sure."""
    rows = [r for r in document.predictions if r.method == document.predictions[0].method]
    scored = any(np.isfinite(row.settled) for row in rows)
    order = by_error(rows)[:ROWS_SHOWN]
    every = len(order) == len(rows)
    several = len({row.cutoff_s for row in rows if row.decided is None}) > 1
    which = f"{len(rows)} {'predictions' if several else 'holds'}"
    if not every:
        first = "largest errors" if scored else "widest intervals"
        which = f"{ROWS_SHOWN} of {which}, {first} first"
    units = {row.unit for row in rows}
    in_unit = f" in {units.pop()}" if len(units) == 1 and None not in units else ""
    headings = ["hold", "cut-off", "predicted", *["unit"] * (len(units) > 1), "±"]
    headings += ["interval"] * (console.width >= WIDE)
    headings += ["settled", "error"] * scored + ["status"]
    table = empty_table(
        console,
        f"Value{in_unit} predicted for {document.horizon_s:g} s by {rows[0].method}: {which}",
        *headings,
    )
    for index in sorted(order) if every else order:
        cells = _row_cells(rows[index])
        table.add_row(*(cells[heading] for heading in headings))
    console.print(table)
    console.print(f"[dim]±: half-width of the {level:.0%} interval[/dim]", highlight=False)


def _row_cells(row: Prediction) -> dict[str, str]:
    from rich.markup import escape

    error_percent = float(score_predictions([row]).error_percent[0])
    sure = np.isfinite(row.low) and row.predicted != 0
    half_percent = 50 * (row.high - row.low) / abs(row.predicted) if sure else float("nan")
    return {
        "hold": escape(row.hold_id + (f" {row.channel}" if row.channel else "")),
        "cut-off": f"{row.cutoff_s:.3g} s",
        "predicted": _text(row.predicted),
        "unit": row.unit or "-",
        "±": f"{half_percent:.1f} %" if np.isfinite(half_percent) else "-",
        "interval": f"{_text(row.low)}..{_text(row.high)}" if np.isfinite(row.low) else "-",
        "settled": _text(row.settled),
        "error": f"{round(error_percent, 1) + 0.0:+.1f} %" if np.isfinite(error_percent) else "-",
        "status": str(row.status),
    }


def _text(figure: float | None) -> str:
    """Return a value with four digits or its whole ones."""
    if figure is None or not np.isfinite(figure):
        return "-"
    whole = 1e4 <= abs(figure) < 1e6
    return f"{figure:.0f}" if whole else f"{figure:#.4g}".rstrip(".")
