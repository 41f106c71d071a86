"""What the README shows must run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.pages import ROOT, run_line

from palpate.cli import VERBS

README = (ROOT / "README.md").read_text()
#: What stands in the `sh` blocks of the three doors; `git clone` needs a network.
DOORS = [
    block
    for block in re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL)
    if "git clone" not in block
]


@pytest.mark.slow
@pytest.mark.parametrize("path", DOORS, ids=["force", "grasp", "station"])
def test_readme_commands_run_in_an_empty_folder(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    for command in re.split(r"\n|&&", path.strip()):
        assert run_line(command) == 0, command
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.slow
def test_make_demo_prints_numbers_and_draws_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    recipe = (ROOT / "Makefile").read_text().split("\ndemo: ")[1].split("\n\n")[0]
    for line in re.findall(r"\t\$\(BIN\)/(palpate .*)", recipe):
        assert run_line(line) == 0, line
    shown = capsys.readouterr().out
    for quantity in ("Size, mm", "Grip force, N", "Firmness, 0 to 100", "Stiffness, N/mm"):
        assert re.search(rf"{quantity} +[\d.]+  +[\d.]+ … [\d.]+", shown), quantity
    assert shown.splitlines()[-1] == "Written: out/demo.png"
    assert (tmp_path / "out" / "demo.png").stat().st_size > 10_000


def test_readme_python_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    exec(block, {})
    printed = capsys.readouterr().out
    assert printed.count("N, ") == 5
    assert printed.rstrip().endswith("held")


def test_readme_picture_is_small_and_labelled_simulated() -> None:
    picture = ROOT / "docs" / "images" / "grasp.svg"
    assert picture.stat().st_size < 300_000
    assert "simulated" in picture.read_text(encoding="utf-8")


def test_readme_verbs_and_links_exist() -> None:
    assert set(re.findall(r"(?:`|\n|&& )palpate ([a-z]+)", README)) <= VERBS.keys()
    links = re.findall(r"\]\((?!https)([^)#]+)(?:#[^)]*)?\)", README)
    assert [target for target in links if not (ROOT / target).exists()] == []
