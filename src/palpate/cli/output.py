"""Output of the verbs: one JSON document, tables that fit the terminal, cards."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

#: Characters of each line that the frame of a card takes.
CARD_FRAME = 6
SIMULATED = "[bold yellow]SIMULATED on the twin[/]"


def say(text: str) -> None:
    """Print progress, a warning or advice on standard error."""
    print(text, file=sys.stderr, flush=True)


def print_json(document: object) -> None:
    """Print the one JSON document of a verb."""
    print(json.dumps(document, allow_nan=False, indent=1), flush=True)


def print_card(
    console: Console,
    *parts: RenderableType | None,
    title: str | Text,
    subtitle: str | None,
    style: str = "none",
) -> None:
    """Print parts in a frame, with an empty line where one is None."""
    shown = Group(*(Text("") if part is None else part for part in parts))
    console.print(
        Panel(
            shown,
            title=title,
            subtitle=subtitle,
            border_style=style,
            padding=(1, 2),
            expand=False,
        )
    )


def time_text(moment: datetime) -> str:
    """Return a time in this machine's time zone, to the minute."""
    return moment.astimezone().strftime("%Y-%m-%d %H:%M")


def percent_text(fraction: float | None) -> str:
    """Return a fraction as a percentage, a dash for None.

    >>> percent_text(0.875), percent_text(None)
    ('88 %', '-')
    """
    return "-" if fraction is None else f"{100 * fraction:.0f} %"


@contextmanager
def progress(
    title: str, *, total: float | None = None, quiet: bool = False
) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on a terminal; yield the function that advances it.

    `total`: when it is done; without it the bar shows only that work continues, and for how long.
    """
    console = Console(stderr=True)
    columns = [TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()]
    bar = Progress(
        *(columns if total is None else Progress.get_default_columns()),
        console=console,
        transient=True,
        disable=quiet or not console.is_terminal,
        # What goes into a file or a pipe stays out of the terminal.
        redirect_stdout=sys.stdout.isatty(),
    )
    with bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)
