"""What `palpate study` reports where the studies are not installed."""

from __future__ import annotations

from palpate.cli import build_app, run
from palpate.commands import research


def test_it_reports_what_to_install(monkeypatch, capsys) -> None:
    monkeypatch.setattr(research, "entry_points", lambda *, group: ())
    assert run(build_app(), ["study", "table1"], name="palpate") == 2
    assert "pip install ./studies" in capsys.readouterr().err
