"""Help, completion in bash and the progress bar."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.commands import Command

from palpate import __version__
from palpate.cli import VERBS, build_app
from palpate_station.records import Item
from palpate_station.store import Store

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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a command `palpate` and a store of items."""
    path = tmp_path_factory.mktemp("completion")
    command = path / "palpate"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m palpate "$@"\n')
    command.chmod(0o755)
    with Store.open(path / "palpate-items.sqlite") as store:
        for name in ("fruit-3", "apple-1"):
            store.add_item(Item(item_id=name))
    return path


def complete(line: str, folder: Path) -> list[str]:
    """Return the completions that bash offers for the last word of a line."""
    words = line.split(" ")
    script = (
        'eval "$(_PALPATE_COMPLETE=source_bash palpate)"; '
        f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; "
        '_palpate_completion palpate; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        [shutil.which("bash") or "bash", "-c", script],
        cwd=folder,
        env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "PALPATE_STORE": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("palpate gra", ["grasp"]),
        ("palpate grasp --object straw", ["strawberry"]),
        ("palpate grasp --rig sim-f", ["sim-firmware"]),
        ("palpate calibrate se", ["settling"]),
        ("palpate study table1", ["table1"]),
        ("palpate grasp --item fruit-3", ["fruit-3"]),
        ("palpate items --store nowhere.sqlite fruit", []),
    ],
)
def test_completion_in_bash_lists_verbs_and_options(
    line: str, offered: list[str], folder: Path
) -> None:
    assert complete(line, folder) == offered
    assert not (folder / "nowhere.sqlite").exists()
