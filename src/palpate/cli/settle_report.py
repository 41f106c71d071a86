"""Output of `palpate settle`: tables, files and a plot of selected holds."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from palpate.cli.settle_source import HoldSource
from palpate.holds.cutting import CutColumn
from palpate.plots.settle import MOST_OVERVIEWS, Panel, settle_figure
from palpate.plots.style import save_figure
from palpate.scoring.predictions import Prediction
from palpate.scoring.table import (
    PIPED_WIDTH,
    WIDE,
    ScoreTable,
    format_figure,
    print_scores,
)
from palpate.settling.result import SettlingMethod
from palpate.terminal_table import make_console, print_table

#: Number of listed holds, largest errors first.
ROWS_SHOWN = 10


def rank_by_error(predictions: Sequence[Prediction]) -> list[int]:
    """Return indices by error, largest first; without settled values, by interval width.

    Predictions with neither value are last, in their original order.
    """
    keys = np.array([row.error_percent for row in predictions])
    if not np.isfinite(keys).any():
        keys = np.array([row.high - row.low for row in predictions])
    size = np.abs(np.nan_to_num(keys, nan=0.0, posinf=np.inf))
    return [int(index) for index in np.argsort(-size, kind="stable")]


def draw(
    document: ScoreTable,
    source: HoldSource,
    plot: Path,
    *,
    methods: Mapping[str, SettlingMethod],
) -> None:
    """Draw the holds with the median, the 90th percentile and the largest error.

    The ranking uses the first method at its first cut-off. The selected holds are read again, which
    avoids storing all holds in memory.
    """
    rows = next(iter(document.groups().values()))
    rows = [row for row in rows if np.isfinite(row.error_percent)] or rows
    order = [rows[index] for index in reversed(rank_by_error(rows))]
    places = {
        "median error": (len(order) - 1) // 2,
        "90th percentile": round(0.9 * (len(order) - 1)),
        "largest error": len(order) - 1,
    }
    # In a short file one hold can have several ranks; the last name is used.
    wanted = {
        (row.source, row.hold_id, row.channel): (name, row)
        for name, row in ((name, order[place]) for name, place in places.items())
    }
    panels = {}
    for file in source.files():
        for hold in source.holds(file, until_s=document.horizon_s):
            key = (str(file), hold.hold_id, hold.channel)
            if key in wanted:
                name, row = wanted[key]
                error = ""
                if np.isfinite(row.error_percent):
                    percent = f"{row.error_percent:+.2g}".replace("-", "\N{MINUS SIGN}")
                    which = f"{row.method} " if len(methods) > 1 else ""
                    error = f": {which}{percent}\N{NO-BREAK SPACE}%"
                title = f"{name}{error}\n{hold.hold_id} {hold.channel or ''}"
                panels[key] = Panel(title=title, hold=hold, cutoff_s=row.cutoff_s)
    figure = settle_figure(
        [panels[key] for key in wanted],
        methods=methods,
        horizon_s=document.horizon_s,
        level=document.level,
        overviews=list(islice(_overviews(source), MOST_OVERVIEWS)),
    )
    save_figure(figure, plot)


def _overviews(source: HoldSource) -> Iterator[tuple[str, CutColumn]]:
    """Yield recordings with their titles and the places where they were cut."""
    for file in source.recordings():
        for column in source.columns(file):
            if np.isfinite(column.values).any():
                yield f"{file.name}, {column.column}: {len(column.spans)} holds", column


def print_tables(document: ScoreTable, *, written: Sequence[Path]) -> None:
    """Print the predictions, then the errors of holds that last until the horizon."""
    console = make_console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    _print_holds(document, console)
    for method in dict.fromkeys(row.method for row in document.predictions):
        counts = Counter(str(r.status) for r in document.predictions if r.method == method)
        by_status = ", ".join(f"{n} {status}" for status, n in counts.most_common())
        console.print(f"Status of {method}: {by_status}", highlight=False)
    if any(np.isfinite(row.settled) for row in document.predictions):
        print_scores(document.summary(), console, level=document.level)
    else:
        console.print(f"No hold lasts {document.horizon_s:g} s, so the errors are unknown.")
    for entry in document.summary():
        if "holds_decided" in entry:
            others = entry["holds"] - entry["holds_decided"]
            console.print(
                f"{entry['method']}: ± fell below {entry['until_half_width_percent']:g} % in "
                f"{entry['holds_decided']} of {entry['holds']} holds (median time: "
                f"{format_figure(entry['median_decision_s'])} s)"
                + ("; the others used the full hold" if others else "")
            )
    for path in written:
        console.print(f"Written: {path}", highlight=False, soft_wrap=True)


def _print_holds(document: ScoreTable, console: Console) -> None:
    """Print the holds of the first method with the largest errors or widest intervals."""
    rows = [r for r in document.predictions if r.method == document.predictions[0].method]
    scored = any(np.isfinite(row.settled) for row in rows)
    order = rank_by_error(rows)[:ROWS_SHOWN]
    every = len(order) == len(rows)
    several = len({row.cutoff_s for row in rows if row.decided is None}) > 1
    which = f"{len(rows)} {'prediction' if several else 'hold'}{'s' * (len(rows) != 1)}"
    if not every:
        first = "largest errors" if scored else "widest intervals"
        which = f"{ROWS_SHOWN} of {which}, {first} first"
    units = {row.unit for row in rows}
    in_unit = f" in {units.pop()}" if len(units) == 1 and None not in units else ""
    has_interval = any(np.isfinite(row.low) for row in rows)
    headings = ["hold", ">cut-off", ">predicted", *[">unit"] * (len(units) > 1)]
    headings += [">±"] * has_interval + [">interval"] * (has_interval and console.width >= WIDE)
    headings += [">settled", ">error"] * scored + [">status"]
    console.print(
        f"Value{in_unit} predicted for {document.horizon_s:g} s by {rows[0].method}: {which}",
        highlight=False,
    )
    shown = [_row_cells(rows[index]) for index in (sorted(order) if every else order)]
    cells = [[row[heading.lstrip(">")] for heading in headings] for row in shown]
    print_table(headings, cells, console=console)
    if has_interval:
        console.print(
            f"[dim]±: half-width of the {document.level:.0%} interval, in % of the settled value, "
            "or of the predicted value if that is unknown[/dim]",
            highlight=False,
        )


def _row_cells(row: Prediction) -> dict[str, str]:
    error_percent = row.error_percent
    magnitude = abs(row.settled if np.isfinite(row.settled) else row.predicted)
    has_interval = np.isfinite(row.low) and magnitude > 0
    half_percent = 50 * (row.high - row.low) / magnitude if has_interval else float("nan")
    return {
        "hold": escape(row.hold_id + (f" {row.channel}" if row.channel else "")),
        "cut-off": f"{row.cutoff_s:.3g} s",
        "predicted": _text(row.predicted),
        "unit": escape(row.unit or "-"),
        "±": f"{half_percent:.1f} %" if np.isfinite(half_percent) else "-",
        "interval": f"{_text(row.low)}..{_text(row.high)}" if np.isfinite(row.low) else "-",
        "settled": _text(row.settled),
        "error": f"{round(error_percent, 1) + 0.0:+.1f} %" if np.isfinite(error_percent) else "-",
        "status": str(row.status),
    }


def _text(figure: float | None) -> str:
    """Format a value with four significant digits, or as an integer from 1e4 to 1e6."""
    if figure is None or not np.isfinite(figure):
        return "-"
    is_integer = 1e4 <= abs(figure) < 1e6
    return f"{figure:.0f}" if is_integer else f"{figure:#.4g}".rstrip(".")
