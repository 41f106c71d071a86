"""A bar on standard error while something takes long; none without a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


@contextmanager
def progress(
    title: str, *, total: float | None = None, quiet: bool = False
) -> Iterator[Callable[[float], None]]:
    """Show a bar where standard error is a terminal; yield a function that takes how much is done.

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
