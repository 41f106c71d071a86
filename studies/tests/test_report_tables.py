"""Tables of studies in narrow terminals: nothing is left out of them."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from palpate_studies.report import Table, _print_table

TABLE = Table(
    title="Errors",
    columns=("predictor", "median, %", "mean, %", "90 %, %", "covered", "half-width"),
    rows=[("relaxation", "1.1", "1.2", "3.1", "0.91", "7.7"), ("exponential", *"45678")],
)


@pytest.mark.parametrize("width", [40, 60, 80])
def test_every_cell_is_shown_whole(width: int) -> None:
    out = StringIO()
    _print_table(Console(file=out, width=width), TABLE)
    shown = out.getvalue()
    for words in (*TABLE.columns, *TABLE.rows[0]):
        assert all(word in shown for word in words.split())
    assert max(map(len, shown.splitlines())) <= width
