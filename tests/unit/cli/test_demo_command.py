"""`palpate demo`: the files it writes, and that what it proposes to try works as typed."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest

from palpate.cli import build_app, run


def palpate(*arguments: str) -> int:
    return run(build_app(), list(arguments), name="palpate")


@pytest.mark.parametrize("name", ["recordings", "packhouse"])
def test_what_it_proposes_works_as_typed(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    assert palpate("demo", name) == 0
    shown = capsys.readouterr().out
    assert "simulated" in shown
    proposed = [line.split() for line in shown.split("Try:\n")[1].splitlines()]
    assert proposed
    for line in proposed:
        if line[0] == "cd":
            os.chdir(line[1])
            continue
        assert palpate(*shlex.split(" ".join(line))[1:]) == 0, line


def test_a_store_is_not_added_to_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert palpate("demo", "packhouse", "--out", str(tmp_path / "a")) == 0
    assert palpate("demo", "packhouse", "--out", str(tmp_path / "a")) == 2
    assert "is there already" in capsys.readouterr().err


def test_recordings_are_labelled_simulated(tmp_path: Path) -> None:
    assert palpate("demo", "recordings", "--out", str(tmp_path)) == 0
    tables = sorted(tmp_path.glob("*.csv"))
    assert len(tables) == 3
    for table in tables:
        assert "simulated" in table.read_text(encoding="utf-8").splitlines()[0]


def test_an_unknown_demo_names_those_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert palpate("demo", "circus") == 2
    assert "recordings, packhouse" in capsys.readouterr().err
