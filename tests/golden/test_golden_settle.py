"""The document of `palpate settle` on a file small enough to compute by hand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer

from palpate.cli import run
from palpate.cli.settle import settle

GOLDEN = Path(__file__).parent / "settle"


def test_settle_json_matches_hand_calculation(capsys: pytest.CaptureFixture[str]) -> None:
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command()(settle)
    holds = GOLDEN / "holds.csv"
    arguments = [str(holds), "--method", "recorded", "--cutoff", "2.5", "--json"]
    assert run(app, arguments, name="palpate settle") == 0
    document = json.loads(capsys.readouterr().out)
    for row in document["rows"]:
        assert row.pop("file") == str(holds)
    assert document == json.loads((GOLDEN / "recorded.json").read_text())
