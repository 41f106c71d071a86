"""Help of every verb: it fits the terminal and shows every bracketed text."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from tests.commands import Command

from palpate import __version__
from palpate.cli import VERBS, build_app

#: Verbs of other packages that parse the rest of the line themselves.
NAMED = ("study", "bench")
STEPS = {"calibrate", "archive"}
PAGES = [[], *([verb] for verb in VERBS)]
PAGES += [[verb, step] for verb in sorted(STEPS) for step in build_app().load(verb).commands]


@pytest.mark.parametrize("words", PAGES, ids=" ".join)
def test_help_fits_80_columns_and_shows_all_bracketed_text(
    words: list[str], palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown = palpate(*words, "--help").out
    assert max(map(len, shown.splitlines())) <= 80
    assert "…" not in shown
    command = build_app()
    if not words or words[0] in NAMED:
        return
    for word in words:
        command = command.load(word)
    text = re.sub(r"[\s│]+", "", shown)
    for wanted in (command.help, *(parameter.help for parameter in command.params)):
        for bracket in re.findall(r"\[[^\]]+\]", wanted or ""):
            assert re.sub(r"\s+", "", bracket) in text


def test_python_m_palpate_runs_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "palpate", "--version"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert done.stdout == f"palpate {__version__}\n"
