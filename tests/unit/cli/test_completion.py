"""Completion in bash."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.produce.records import Item
from palpate.produce.store import Store


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
