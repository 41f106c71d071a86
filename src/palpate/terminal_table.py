"""Terminal tables in a uniform style that adapt to the width of the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text


def make_table(columns: Sequence[str], rows: Iterable[Sequence[Any]] = ()) -> Table:
    """Return a table without borders; a leading ``>`` in a name right-aligns the column."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_edge=False, header_style="dim")
    for column in columns:
        right = column.startswith(">")
        table.add_column(column.lstrip(">"), justify="right" if right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[Any]], *, console: Console | None = None
) -> None:
    """Print a table that fits the width of the terminal."""
    console = console or Console(highlight=False, emoji=False)
    console.print(fit_table(make_table(columns, rows), console=console))


def fit_table(table: Table, *, console: Console, taken: int = 0) -> RenderableType:
    """Return a table in columns if all words fit, else one paragraph per row.

    Parameters
    ----------
    taken : int
        Characters per line occupied by the surroundings of the table.

    Examples
    --------
    >>> def show(width):
    ...     table = Table("item", "stage", box=None, padding=(0, 1, 0, 0))
    ...     table.add_row("fruit-5", "nearly ripe")
    ...     console = Console(width=width)
    ...     console.print(fit_table(table, console=console))
    >>> show(16)  # doctest: +NORMALIZE_WHITESPACE
    item    stage
    fruit-5 nearly
            ripe
    >>> show(14)  # doctest: +NORMALIZE_WHITESPACE
    item fruit-5
    · stage nearly
    ripe
    """
    if _fit_columns(table, room=console.width - taken, console=console):
        return table
    rows = zip(*(column.cells for column in table.columns), strict=True)
    return Group(*(_format_row(table, row) for row in rows))


def _fit_columns(table: Table, *, room: int, console: Console) -> bool:
    """Narrow columns at word boundaries until a table fits; return whether it fits.

    Rich itself narrows the widest column first and breaks words.
    """
    spans = [_column_widths(column, console) for column in table.columns]
    if table.box is None and sum(widest for _, widest in spans) + _gap_width(table) > room:
        table.padding = (0, 1, 0, 0)
    spare = room - _gap_width(table) - sum(narrowest for narrowest, _ in spans)
    widths = [narrowest for narrowest, _ in spans]
    # Widen the narrowest column first, because it would have the most lines.
    for _ in range(spare):
        narrowed = [n for n, (_, widest) in enumerate(spans) if widths[n] < widest]
        if narrowed:
            widths[min(narrowed, key=widths.__getitem__)] += 1
    for column, width in zip(table.columns, widths, strict=True):
        column.width = width
    return spare >= 0


def _gap_width(table: Table) -> int:
    _, right, _, left = table.padding
    lines = 0 if table.box is None else len(table.columns) + 1
    return lines + len(table.columns) * (left + right)


def _column_widths(column: Column, console: Console) -> tuple[int, int]:
    """Return the widths of a column's longest word and longest line."""
    found = [
        Measurement.get(console, console.options.update(max_width=10_000), cell)
        for cell in (column.header, *column.cells)
    ]
    widest = max(one.maximum for one in found)
    return widest if column.no_wrap else max(one.minimum for one in found), widest


def _format_row(table: Table, row: tuple[RenderableType, ...]) -> Text:
    """Return a row as text: each cell after its column name, further lines in brackets."""
    pieces = []
    for column, cell in zip(table.columns, row, strict=True):
        name = ", ".join(str(column.header).split("\n")).strip(", ")
        first, *rest = (
            [cell]
            if isinstance(cell, Text)
            else (Text.from_markup(line, emoji=False) for line in str(cell).split("\n"))
        )
        text = Text.assemble(first, *(Text.assemble(" (", one, ")") for one in rest))
        pieces.append(Text.assemble((f"{name} ".lstrip(), "dim"), text))
    return Text(" · ").join(pieces)
