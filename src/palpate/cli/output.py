"""What verbs print: one JSON document, tables that fit the terminal, and cards."""

from __future__ import annotations

import json
from datetime import datetime

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.text import Text

#: Characters of each line that the frame of a card takes.
CARD_FRAME = 6
SIMULATED = "[bold yellow]SIMULATED on the twin[/]"


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
