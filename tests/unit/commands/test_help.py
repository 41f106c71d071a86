"""Help of every verb: an example, placeholders in words, nothing of Python's types."""

from __future__ import annotations

import importlib
import inspect
import re
import subprocess
import sys
from typing import get_type_hints

import pytest
import typer

from palpate.cli import GROUPS, VERBS, build_app, run
from palpate.commands import calibrate
from palpate.commands.packages import ARCHIVE, catalogue
from palpate.commands.steps import function_at

#: Verbs with a list of names in place of options.
LISTS = ("study", "bench", "calibrate", "archive")
STEPS = {"calibrate": calibrate.STEPS, "archive": catalogue(ARCHIVE)}
PAGES = [[verb] for verb in VERBS if verb not in LISTS]
PAGES += [[verb, step] for verb, steps in STEPS.items() for step in steps]


def page(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert run(build_app(), [*words, "--help"], name="palpate") == 0
    return capsys.readouterr().out


@pytest.fixture(autouse=True)
def terminal_of_80_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("words", PAGES, ids=" ".join)
def test_options_have_placeholders_in_words(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    shown = page(words, capsys)
    assert "--help" in shown.split("Options", 1)[1]
    assert not re.search(r"<\w", shown)
    assert "[[" not in shown


@pytest.mark.parametrize("words", PAGES, ids=" ".join)
def test_nothing_is_swallowed_or_cut_off(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    if len(words) > 1:
        function = function_at(STEPS[words[0]][words[1]][0])
    else:
        function = getattr(importlib.import_module(f"palpate.commands.{words[0]}"), words[0])
    hints = get_type_hints(function, include_extras=True).values()
    helps = [meta.help for hint in hints for meta in getattr(hint, "__metadata__", ())]
    text = re.sub(r"[\s│]+", "", page(words, capsys))
    for wanted in (*helps, inspect.getdoc(function)):
        for bracket in re.findall(r"\[[^\]]+\]", wanted or ""):
            assert re.sub(r"\s+", "", bracket) in text
    assert "…" not in text


@pytest.mark.parametrize("words", [[verb] for verb in VERBS] + PAGES, ids=" ".join)
def test_pages_fit_80_columns(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert max(map(len, page(words, capsys).splitlines())) <= 80


def test_one_name_for_one_thing() -> None:
    """Options of several verbs that mean the same have the same name."""
    names = {
        name
        for command in typer.main.get_command(build_app()).commands.values()
        for parameter in command.params
        for name in parameter.opts
    }
    assert "--duration" in names
    assert names.isdisjoint({"--seconds", "--serial-port", "--output", "--output-dir", "--rate"})


def test_the_first_page_groups_the_verbs(capsys: pytest.CaptureFixture[str]) -> None:
    first = page([], capsys)
    places = [first.index(f" {heading} ") for heading in GROUPS]
    assert places == sorted(places)
    assert "Example" not in first
    assert max(map(len, first.splitlines())) <= 80


def test_it_runs_as_a_module() -> None:
    told = subprocess.run(
        [sys.executable, "-m", "palpate", "--version"], capture_output=True, text=True
    )
    assert told.returncode == 0
    assert told.stdout.startswith("palpate ")
