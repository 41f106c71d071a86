"""Which rig a verb takes where none is named: this folder's, the environment's, or the twin."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.cli import build_app, run
from palpate.cli.options import rig_of_environment


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_RIG", raising=False)
    return tmp_path


def grasp(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    status = run(build_app(), ["grasp", "--seed", "2", *arguments], name="palpate")
    shown = capsys.readouterr()
    return status, shown.out, shown.err


@pytest.mark.slow
def test_simulation_that_nobody_asked_for_is_labelled(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, err = grasp(capsys)
    assert "SIMULATED" in out
    assert err == ""


def test_the_folder_comes_before_the_environment(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PALPATE_RIG", "nowhere")
    status, _, err = grasp(capsys)
    assert status == 2
    assert "no rig 'nowhere'" in err
    (folder / "rig.toml").write_text('use = "sim-elsewhere"\n')
    status, _, err = grasp(capsys)
    assert status == 2
    assert "no rig 'sim-elsewhere'" in err
    assert rig_of_environment() == "rig.toml"
