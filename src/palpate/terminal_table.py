"""Terminal tables in a uniform style that adapt to the width of the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import IO, Any

from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.panel import Panel
from rich.table import Column, Table
from rich.text import Text


class _WholeWordConsole(Console):
    """A console that never breaks a word: a longer one extends beyond the terminal's width."""

    def print(self, *objects: Any, **settings: Any) -> None:
        """Print objects, at the width of the longest word if that exceeds the terminal's."""
        markup = settings.get("markup")
        texts = (self.render_str(o, markup=markup) if isinstance(o, str) else o for o in objects)
        needed = max((shortest_width(one, console=self) for one in texts), default=0)
        before = self._width
        if needed > self.width:
            self._width = needed
        try:
            super().print(*objects, **settings)
        finally:
            self._width = before


def make_console(*, width: int | None = None, file: IO[str] | None = None) -> Console:
    """Return a console that prints every number whole, however narrow the terminal.

    `width`: characters per line; by default those of the terminal.
    `file`: receives the output; by default standard output.
    """
    return _WholeWordConsole(width=width, file=file, highlight=False, emoji=False)


def shortest_width(shown: RenderableType, *, console: Console) -> int:
    """Return the smallest width at which no word is broken, characters; 0 for a frame.

    A frame measures its longest line, and its content was fitted before.
    """
    return 0 if isinstance(shown, Panel) else _measure(shown, console=console).minimum


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
    console = console or make_console()
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


def _measure(shown: RenderableType, *, console: Console) -> Measurement:
    return Measurement.get(console, console.options.update(max_width=10_000), shown)


def _column_widths(column: Column, console: Console) -> tuple[int, int]:
    """Return the widths of a column's longest word and longest line."""
    found = [_measure(cell, console=console) for cell in (column.header, *column.cells)]
    widest = max(one.maximum for one in found)
    if column.max_width is not None:
        widest = min(widest, column.max_width)
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
