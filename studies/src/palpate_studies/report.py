"""The report of a study: tables to read, figures to look at, and one JSON document."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from palpate.errors import InputError, needing
from palpate.files import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console


def _folder(out: Path | None) -> Path | None:
    """Refuse, before the hours of a study, a folder that could not be written to after them."""
    if out is not None:
        places = (out, *out.absolute().parents)
        existing = next(place for place in places if place.exists())
        if not existing.is_dir():
            raise InputError(f"--out {out}: {existing} is not a folder; name one to write into")
        if not os.access(existing, os.W_OK):
            raise InputError(f"--out {out}: no right to write to {existing}; choose another place")
    return out


OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="Folder for the report: JSON, tables and figures.",
        metavar="DIR",
        callback=_folder,
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A titled table; cells are printed as they are."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]

    def as_markdown(self) -> str:
        """Return the table as Markdown, its title above it."""
        lines = [f"**{self.title}**", "", "| " + " | ".join(self.columns) + " |"]
        lines.append("|" + "---|" * len(self.columns))
        lines += ["| " + " | ".join(row) + " |" for row in self.rows]
        return "\n".join(lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyReport:
    """The outcome of one study.

    Attributes
    ----------
    name, title : str
        As on the command line, and in words.
    provenance : sequence of str
        What is real, simulated or published, and which published entries were calibration inputs.
    tables : sequence of Table
        For people.
    payload : mapping
        The JSON document.
    figures : mapping of str to callable
        File stem -> function that draws it; called only where figures are wanted.
    """

    name: str
    title: str
    provenance: Sequence[str]
    tables: Sequence[Table]
    payload: Mapping[str, Any]
    figures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)

    def emit(self, *, as_json: bool, out: Path | None) -> None:
        """Print the report (JSON or tables) and, where asked, write it to a folder."""
        if out is not None:
            self.write(out)
        if as_json:
            json.dump(self.payload, sys.stdout, allow_nan=False)
            sys.stdout.write("\n")
            return
        from rich.console import Console

        # Piped into a file, names in tables must not be cut at 80 columns.
        console = Console(width=None if sys.stdout.isatty() else 120)
        console.print(f"[bold]{self.title}[/bold]")
        for line in self.provenance:
            console.print(f"[dim]{line}[/dim]", highlight=False)
        for table in self.tables:
            _print_table(console, table)
        if out is not None:
            console.print(f"Written to {out}")

    def write(self, out: Path) -> None:
        """Write `<name>.json`, `<name>.md` and the files of each figure into a folder."""
        out.mkdir(parents=True, exist_ok=True)
        with atomic_path(out / f"{self.name}.json") as path:
            path.write_text(json.dumps(self.payload, allow_nan=False, indent=1) + "\n")
        body = [f"# {self.title}", *self.provenance, *(t.as_markdown() for t in self.tables)]
        with atomic_path(out / f"{self.name}.md") as path:
            path.write_text("\n\n".join(body) + "\n")
        from palpate.plots.style import letter_panels, save_figures

        for stem, draw in self.figures.items():
            with needing("a figure", extra="plots"):
                figure = draw()
            letter_panels(figure)
            save_figures(figure, out / stem)


def _print_table(console: Console, table: Table) -> None:
    """Print a table; one that the terminal has no room for as a list of its rows, cell by cell."""
    from rich.table import Table as RichTable

    from palpate.commands.fitted_table import narrowed

    view = RichTable(*table.columns, title=table.title, title_justify="left")
    for row in table.rows:
        view.add_row(*row)
    if narrowed(view, room=console.width, console=console):
        console.print(view)
        return
    console.print(f"[italic]{table.title}[/italic]")
    for row in table.rows:
        cells = RichTable.grid(padding=(0, 2))
        for column, cell in zip(table.columns, row, strict=True):
            cells.add_row(column, cell)
        console.print(cells)
        console.print()
