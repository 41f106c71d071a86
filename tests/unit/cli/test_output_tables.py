"""Tables in narrow and wide terminals."""

from __future__ import annotations

import re
from io import StringIO

import pytest
from rich.console import Console
from rich.table import Table
from rich.text import Text

from palpate.terminal_table import fit_table

ROWS = (
    ("fruit-17", "2026-05-14 08:02", "[bold]62.0[/]\n[dim]61.6…62.4[/]", Text("conditioned")),
    ("ball", "2026-05-15 09:30", "-", Text("no measurement is stored, [as] yet")),
)


def render_table(width: int) -> str:
    table = Table("item", "last grasp", "size\nmm", "verdict", box=None, padding=(0, 2, 0, 0))
    for row in ROWS:
        table.add_row(*row)
    console = Console(width=width, file=StringIO(), highlight=False)
    console.print(fit_table(table, console=console))
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [24, 40, 46, 60, 80, 200])
def test_table_shows_every_word_uncut(width: int) -> None:
    shown = render_table(width)
    assert max(map(len, shown.splitlines())) <= width
    words = "item last grasp size mm verdict fruit-17 2026-05-14 08:02 62.0 61.6…62.4 conditioned"
    words += " ball 2026-05-15 09:30 no measurement is stored, [as] yet"
    assert set(words.split()) <= set(re.split(r"[\s()]+|, ", shown)) | set(shown.split())


def test_table_in_a_wide_terminal_has_one_line_per_row() -> None:
    assert render_table(200).splitlines()[2].split() == [
        "fruit-17",
        "2026-05-14",
        "08:02",
        "62.0",
        "conditioned",
    ]


def test_table_in_a_tiny_terminal_prints_rows_as_labelled_paragraphs() -> None:
    one = " ".join(render_table(40).split())
    assert "item fruit-17 · last grasp 2026-05-14 08:02 · size, mm 62.0 (61.6…62.4) ·" in one
