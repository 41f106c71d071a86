"""Tables that fit the terminal: no word is cut, and no column is left out."""

from __future__ import annotations

from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text


def fitted(table: Table, *, console: Console, taken: int = 0) -> RenderableType:
    """Return a table without lines in columns where all its words fit, else row by row.

    Rich narrows the widest column first, in the middle of its words.

    Parameters
    ----------
    taken : int
        Characters of each line that lie around the table.

    Examples
    --------
    >>> def printed(width):
    ...     table = Table("item", "stage", box=None, padding=(0, 1, 0, 0))
    ...     table.add_row("fruit-5", "nearly ripe")
    ...     console = Console(width=width)
    ...     console.print(fitted(table, console=console))
    >>> printed(16)  # doctest: +NORMALIZE_WHITESPACE
    item    stage
    fruit-5 nearly
            ripe
    >>> printed(14)  # doctest: +NORMALIZE_WHITESPACE
    item fruit-5
    · stage nearly
    ripe
    """
    spans = [_span(column, console) for column in table.columns]
    room = console.width - taken
    if sum(widest for _, widest in spans) + _gaps(table) > room:
        table.padding = (0, 1, 0, 0)
    spare = room - _gaps(table) - sum(narrowest for narrowest, _ in spans)
    if spare < 0:
        return _listed(table)
    for column, (narrowest, widest) in zip(table.columns, spans, strict=True):
        column.width = narrowest + min(widest - narrowest, spare)
        spare -= column.width - narrowest
    return table


def _gaps(table: Table) -> int:
    _, right, _, left = table.padding
    return len(table.columns) * (left + right)


def _span(column: Column, console: Console) -> tuple[int, int]:
    """Return how narrow and how wide a column is: its longest word, its longest line."""
    found = [
        Measurement.get(console, console.options.update(max_width=10_000), cell)
        for cell in (column.header, *column.cells)
    ]
    widest = max(one.maximum for one in found)
    return widest if column.no_wrap else max(one.minimum for one in found), widest


def _listed(table: Table) -> Group:
    """Return each row as a paragraph: every cell after the name of its column.

    The second line of a cell is in brackets.
    """
    rows = zip(*(column.cells for column in table.columns), strict=True)
    return Group(*(_paragraph(table, row) for row in rows))


def _paragraph(table: Table, row: tuple[RenderableType, ...]) -> Text:
    pieces = []
    for column, cell in zip(table.columns, row, strict=True):
        name = ", ".join(str(column.header).split("\n")).strip(", ")
        first, *rest = (
            [cell] if isinstance(cell, Text) else map(Text.from_markup, str(cell).split("\n"))
        )
        text = Text.assemble(first, *(Text.assemble(" (", one, ")") for one in rest))
        pieces.append(Text.assemble((f"{name} ".lstrip(), "dim"), text))
    return Text(" · ").join(pieces)
