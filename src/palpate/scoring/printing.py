"""The scores of predictions as text: what `palpate settle` prints of them."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

#: Columns of text where standard output is no terminal that has a width of its own.
PIPED_WIDTH = 120

#: From these widths on intervals are shown with their half-widths; columns stand well apart; only
#: names fold.
WIDE, AIRY, NARROWEST = 100, 80, 60


def text_of_scores(summary: Sequence[Mapping[str, Any]], *, level: float) -> str:
    """Return the summary of a `ScoreTable` as lines of text."""
    from rich.console import Console

    text = io.StringIO()
    print_scores(summary, Console(file=text, width=PIPED_WIDTH), level=level)
    return text.getvalue().rstrip()


def print_scores(summary: Sequence[Mapping[str, Any]], console: Console, *, level: float) -> None:
    """Print a row for each method and cut-off of a `ScoreTable`'s summary."""
    table = empty_table(
        console,
        "|error| in % of the settled value",
        *("method", "cut-off", "holds", "median", "mean", "p90", "of rest", f"in {level:.0%}", "±"),
    )
    for entry in summary:
        table.add_row(*_summary_cells(entry))
    console.print(table)
    console.print(
        f"[dim]of rest: median |error| in % of the change still to come; in {level:.0%}: share of "
        "holds inside their interval; ±: median half-width in %[/dim]",
        highlight=False,
    )


def _summary_cells(entry: Mapping[str, Any]) -> list[str]:
    cutoff = "-" if entry["cutoff_s"] is None else f"{entry['cutoff_s']:.3g} s"
    if "holds_decided" in entry:
        cutoff = f"~{cutoff}"
    coverage = entry["coverage"]
    return [
        entry["method"],
        cutoff,
        str(entry["holds"]),
        short(entry["median_abs_error_percent"]),
        short(entry["mean_abs_error_percent"]),
        short(entry["p90_abs_error_percent"]),
        short(entry["median_error_of_remaining_percent"]),
        "-" if coverage is None else f"{coverage:.2f}",
        short(entry["median_half_width_percent"]),
    ]


def empty_table(console: Console, title: str, *headings: str) -> Table:
    """Return an empty table; what is too wide for the terminal is folded, never left out."""
    from rich import box
    from rich.table import Table

    view = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1 if console.width >= AIRY else 0),
        pad_edge=False,
        collapse_padding=True,
    )
    for place, heading in enumerate(headings):
        is_name = place == 0 or heading == "status"
        view.add_column(
            heading,
            justify="left" if place == 0 else "right",
            no_wrap=not is_name and console.width >= NARROWEST,
            overflow="fold",
            min_width=min(10, console.width // 7) if place == 0 else len("status") * is_name,
        )
    return view


def short(figure: float | None) -> str:
    """Return a percentage or a time with as many decimals as its column has room for."""
    if figure is None or not np.isfinite(figure):
        return "-"
    if abs(figure) >= 1e4:
        return f"{figure:.2g}"
    return f"{figure:.{2 if abs(figure) < 10 else 1 if abs(figure) < 100 else 0}f}"
