"""The default rig of a verb: the folder's, the environment's or the twin."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.commands import Command

from palpate.cli.options import find_default_rig


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_RIG", raising=False)
    return tmp_path


@pytest.mark.slow
def test_default_rig_output_is_labelled_simulated(palpate: Command) -> None:
    out, err = palpate("grasp", "--seed", "2")
    assert "SIMULATED" in out
    assert err == ""


def test_find_default_rig_prefers_the_folder_over_the_environment(
    folder: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    monkeypatch.setenv("PALPATE_RIG", "nowhere")
    assert "no rig 'nowhere'" in palpate.refused("grasp")
    (folder / "rig.toml").write_text('use = "sim-elsewhere"\n')
    assert "no rig 'sim-elsewhere'" in palpate.refused("grasp")
    assert find_default_rig() == "rig.toml"
