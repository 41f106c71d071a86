"""Output of the verbs: JSON documents, cards, progress and formatted values."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import stat
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from palpate.errors import InputError
from palpate.files import atomic_path, check_not_input, check_writable, escape_csv_cell
from palpate.terminal_table import fit_table, shortest_width

#: Width of a card's frame and padding, characters per line.
CARD_FRAME = 6
SIMULATED = "[bold yellow]SIMULATED on the twin[/]"


def print_message(text: str) -> None:
    """Print a message on standard error, if anything still receives it."""
    try:
        print(text, file=sys.stderr, flush=True)
    except (OSError, ValueError):
        silence_lost_output()


@contextmanager
def tolerate_lost_output() -> Iterator[None]:
    """Continue after the block if the terminal or the reader of standard output is gone."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        if not is_output_lost(error):
            raise
        silence_lost_output()


def is_output_lost(error: OSError) -> bool:
    """Return whether an error of standard output means that its terminal or reader is gone."""
    return isinstance(error, BrokenPipeError) or is_terminal_lost(error)


def is_terminal_lost(error: OSError) -> bool:
    """Return whether an error means that the terminal was closed."""
    if error.errno != errno.EIO or error.filename is not None:
        return False
    with suppress(OSError, ValueError):
        return stat.S_ISCHR(os.fstat(sys.stdout.fileno()).st_mode)
    return True


def silence_lost_output() -> None:
    """Discard the further output of each standard stream that can't be written."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                sink = os.open(os.devnull, os.O_WRONLY)
                os.dup2(sink, stream.fileno())
                os.close(sink)


def print_json(document: object) -> None:
    """Print a verb's JSON document."""
    print(json.dumps(document, allow_nan=False, indent=1), flush=True)


def finite_or_none(value: float) -> float | None:
    """Return a number for JSON: the value, or None if it is not finite."""
    return value if math.isfinite(value) else None


def print_card(
    console: Console,
    *parts: RenderableType | None,
    title: str | Text,
    subtitle: str | None,
    style: str = "none",
) -> None:
    """Print parts in a frame, with an empty line for each None.

    Tables adapt to the width. Where a word would be broken, the frame is omitted.
    """
    console.print(make_card(console, *parts, title=title, subtitle=subtitle, style=style))


def make_card(
    console: Console,
    *parts: RenderableType | None,
    title: str | Text,
    subtitle: str | None,
    style: str = "none",
) -> RenderableType:
    """Return the card that `print_card` prints."""

    def fit(taken: int) -> list[RenderableType]:
        return [
            fit_table(part, console=console, taken=taken) if isinstance(part, Table) else part or ""
            for part in parts
        ]

    body = Group(*fit(CARD_FRAME))
    heads = [Text.from_markup(one) if isinstance(one, str) else one for one in (title, subtitle)]
    widths = [shortest_width(body, console=console), *(head.cell_len for head in heads if head)]
    if max(widths) + CARD_FRAME > console.width:
        return Group(heads[0] or "", "", *fit(0), "", heads[1] or "")
    return Panel(
        body,
        title=title,
        subtitle=subtitle,
        border_style=style,
        padding=(1, 2),
        expand=False,
    )


def format_time(moment: datetime) -> str:
    """Format a time in the local time zone, to the minute."""
    return moment.astimezone().strftime("%Y-%m-%d %H:%M")


def format_percent(fraction: float | None) -> str:
    """Format a fraction as a percentage, or None as a dash.

    >>> format_percent(0.875), format_percent(None)
    ('88 %', '-')
    """
    return "-" if fraction is None else f"{100 * fraction:.0f} %"


@contextmanager
def progress(
    title: str, *, total: float | None = None, quiet: bool = False
) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on a terminal; yield a function that sets its value.

    `total`: value at completion; without it the bar shows only activity and elapsed time.
    """
    console = Console(stderr=True)
    columns = [TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()]
    bar = Progress(
        *(columns if total is None else Progress.get_default_columns()),
        console=console,
        transient=True,
        disable=quiet or not console.is_terminal,
        # Output to a file or a pipe must not appear on the terminal.
        redirect_stdout=sys.stdout.isatty(),
    )
    with bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


#: Endings of tables that a command writes.
TABLE_ENDINGS = (".json", ".csv", ".parquet")


def check_table_file(path: Path | None, *, option: str, inputs: Sequence[Path]) -> None:
    """Raise `InputError` early if a table's file is an input or can't be written."""
    if path is None:
        return
    if path.suffix.lower() not in TABLE_ENDINGS:
        raise InputError(f"{option} {path}: the name must end in .json, .csv or .parquet")
    check_writable(path)
    check_not_input(path, inputs=inputs)
    if path.suffix.lower() == ".parquet":
        from palpate.holds.table_files import import_pyarrow

        import_pyarrow(f"{option} FILE.parquet")


def write_table(
    path: Path, rows: Sequence[Mapping[str, object]], *, document: object = None
) -> None:
    """Write rows as CSV or Parquet, or the document (by default the rows) as JSON, atomically.

    `path`: checked by `check_table_file`; its ending decides.
    """
    ending = path.suffix.lower()
    with atomic_path(path) as partial:
        if ending == ".json":
            made = json.dumps(rows if document is None else document, allow_nan=False, indent=1)
            partial.write_text(made + "\n", encoding="utf-8")
        elif ending == ".csv":
            with partial.open("w", newline="", encoding="utf-8") as stream:
                writer = csv.DictWriter(stream, fieldnames=list(rows[0]))
                writer.writeheader()
                writer.writerows(
                    {name: escape_csv_cell(cell) for name, cell in row.items()} for row in rows
                )
        else:
            from palpate.holds.table_files import import_pyarrow

            arrow = import_pyarrow("a .parquet file")
            arrow.parquet.write_table(arrow.Table.from_pylist(list(rows)), partial)
