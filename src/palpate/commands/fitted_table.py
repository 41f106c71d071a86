"""Tables that fit the terminal: no word is cut, and no column is left out."""

from __future__ import annotations

from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text


def fitted(table: Table, *, console: Console, taken: int = 0) -> RenderableType:
    """Return a table in columns where all its words fit, else row by row.

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
    return table if narrowed(table, room=console.width - taken, console=console) else _listed(table)


def narrowed(table: Table, *, room: int, console: Console) -> bool:
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
