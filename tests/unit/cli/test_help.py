"""Help of every verb: terminal width, completeness and consistent names."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys

import pytest
from typer.core import TyperGroup

from palpate.cli import GROUPS, VERBS, build_app, run

#: Verbs of other packages that parse the rest of the line themselves.
NAMED = ("study", "bench")
STEPS = {"calibrate", "archive"}
PAGES = [[verb] for verb in VERBS]
PAGES += [[verb, step] for verb in sorted(STEPS) for step in build_app().load(verb).commands]


def page(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert run(build_app(), [*words, "--help"], name="palpate") == 0
    return capsys.readouterr().out


def command_of(words: list[str]):
    command = build_app()
    for word in words:
        command = command.load(word)
    return command


@pytest.fixture(autouse=True)
def terminal_of_80_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("words", PAGES, ids=" ".join)
def test_help_fits_80_columns_and_shows_all_bracketed_text(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    shown = page(words, capsys)
    assert max(map(len, shown.splitlines())) <= 80
    assert "…" not in shown
    if words[0] in NAMED:
        return
    command = command_of(words)
    text = re.sub(r"[\s│]+", "", shown)
    for wanted in (command.help, *(parameter.help for parameter in command.params)):
        for bracket in re.findall(r"\[[^\]]+\]", wanted or ""):
            assert re.sub(r"\s+", "", bracket) in text


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb_starts_with_its_summary(verb: str) -> None:
    command = command_of([verb])
    first = inspect.cleandoc(command.help).split("\n\n")[0]
    assert " ".join(first.split()) == VERBS[verb].summary
    assert "Example: palpate " in command.help


def test_shared_options_have_the_same_name_in_all_verbs() -> None:
    app = build_app()
    commands = [app.load(verb) for verb in VERBS]
    names = {
        name
        for command in commands
        if not isinstance(command, TyperGroup)
        for parameter in command.params
        for name in parameter.opts
    }
    assert "--duration" in names
    assert names.isdisjoint({"--seconds", "--serial-port", "--output", "--output-dir", "--rate"})


def test_help_without_a_verb_groups_the_verbs(capsys: pytest.CaptureFixture[str]) -> None:
    first = page([], capsys)
    places = [first.index(f" {heading} ") for heading in GROUPS]
    assert places == sorted(places)
    assert max(map(len, first.splitlines())) <= 80


def test_python_m_palpate_runs_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "palpate", "--version"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert done.stdout.startswith("palpate ")
