"""Tables of a terminal: one style for all, as narrow as the terminal is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text


def make_table(columns: Sequence[str], rows: Iterable[Sequence[Any]] = ()) -> Table:
    """Return a table without lines; columns whose name begins with ``>`` hold numbers."""
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
    """Print a table, as narrow as the terminal is."""
    console = console or Console(highlight=False)
    console.print(fit_table(make_table(columns, rows), console=console))


def fit_table(table: Table, *, console: Console, taken: int = 0) -> RenderableType:
    """Return a table in columns where all its words fit, else row by row.

    Parameters
    ----------
    taken : int
        Characters of each line that lie around the table.

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
    if _narrow_columns(table, room=console.width - taken, console=console):
        return table
    rows = zip(*(column.cells for column in table.columns), strict=True)
    return Group(*(_paragraph(table, row) for row in rows))


def _narrow_columns(table: Table, *, room: int, console: Console) -> bool:
    """Narrow columns between words until a table fits; return whether it does.

    Rich narrows the widest column first, in the middle of its words.
    """
    spans = [_span(column, console) for column in table.columns]
    if table.box is None and sum(widest for _, widest in spans) + _gaps(table) > room:
        table.padding = (0, 1, 0, 0)
    spare = room - _gaps(table) - sum(narrowest for narrowest, _ in spans)
    widths = [narrowest for narrowest, _ in spans]
    # The narrowest first: it has the shortest words, and would have the most lines.
    for _ in range(spare):
        cramped = [n for n, (_, widest) in enumerate(spans) if widths[n] < widest]
        if cramped:
            widths[min(cramped, key=widths.__getitem__)] += 1
    for column, width in zip(table.columns, widths, strict=True):
        column.width = width
    return spare >= 0


def _gaps(table: Table) -> int:
    _, right, _, left = table.padding
    lines = 0 if table.box is None else len(table.columns) + 1
    return lines + len(table.columns) * (left + right)


def _span(column: Column, console: Console) -> tuple[int, int]:
    """Return the length of a column's longest word, and of its longest line."""
    found = [
        Measurement.get(console, console.options.update(max_width=10_000), cell)
        for cell in (column.header, *column.cells)
    ]
    widest = max(one.maximum for one in found)
    return widest if column.no_wrap else max(one.minimum for one in found), widest


def _paragraph(table: Table, row: tuple[RenderableType, ...]) -> Text:
    """Return a row with its column's name before each cell, second lines in brackets."""
    pieces = []
    for column, cell in zip(table.columns, row, strict=True):
        name = ", ".join(str(column.header).split("\n")).strip(", ")
        first, *rest = (
            [cell] if isinstance(cell, Text) else map(Text.from_markup, str(cell).split("\n"))
        )
        text = Text.assemble(first, *(Text.assemble(" (", one, ")") for one in rest))
        pieces.append(Text.assemble((f"{name} ".lstrip(), "dim"), text))
    return Text(" · ").join(pieces)
