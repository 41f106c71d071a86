"""The documentation's pages: commands run, options exist, tables and pictures agree.

Commands that need a board stand in `console` blocks behind a `$`; of those the verb and its options
are checked.
"""

from __future__ import annotations

import doctest
import json
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.pages import ROOT, blocks, run_line, test_commands_of_page_run
from typer.core import TyperGroup

import palpate
import palpate.errors
from palpate.cli import VERBS, build_app

__all__ = ["test_commands_of_page_run"]

#: Pages whose `sh` and `python` blocks are run.
EXECUTED = (
    *("index", "settle", "python", "build-a-sensor", "bring-up", "ripeness"),
    *("own-gripper-or-sensor", "architecture", "items", "bruise", "sort", "grasp-produce"),
    *("foxglove", "force", "prediction"),
)
#: Start pages, which end with what a command must print; it is run with the page.
STARTS = ("start-sensor", "first-grasp", "start-station")


@pytest.fixture(params=EXECUTED)
def page(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.mark.slow
@pytest.mark.parametrize("page", STARTS)
def test_start_page_check_prints_what_the_page_states(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    *before, (kind, _, stated) = blocks(page)
    assert kind == "text"
    for kind, _, text in before:
        capsys.readouterr()
        if kind == "python":
            exec(compile(text, f"docs/{page}.md", "exec", dont_inherit=True), {})
        if kind == "sh":
            assert [run_line(line) for line in text.splitlines()] == [0] * text.count("\n")
    printed = [" ".join(line.strip("│ ").split()) for line in capsys.readouterr().out.splitlines()]
    for line in stated.splitlines():
        assert any(found.startswith(" ".join(line.split())) for found in printed), printed


def shown_commands() -> list[tuple[str, str]]:
    """Return page and line of every palpate command shown for a board."""
    return [
        (page.stem, line.removeprefix("$ "))
        for page in sorted((ROOT / "docs").glob("*.md"))
        for kind, _, text in blocks(page.stem)
        for line in text.splitlines()
        if kind == "console" and line.startswith("$ palpate ")
    ]


def commands_in_text(page: str) -> list[tuple[str, str]]:
    """Return page and line of every command in a page's tables and paragraphs."""
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    return [(page, line) for line in dict.fromkeys(re.findall(r"`(palpate [a-z][^`]*)`", text))]


def study_options(name: str) -> set[str]:
    from palpate.cli.lazy_group import load_command
    from palpate_studies.verbs import list_commands

    command = load_command(name, list_commands("palpate.studies")[name])
    return {option for parameter in command.params for option in parameter.opts}


@pytest.mark.parametrize(("page", "line"), [*shown_commands(), *commands_in_text("coverage")])
def test_docs_board_command_has_existing_verb_and_options(page: str, line: str) -> None:
    _, verb, *arguments = shlex.split(line, comments=True)
    assert verb in VERBS
    command = build_app().load(verb)
    if isinstance(command, TyperGroup):
        command = command.load(arguments[0])
    known = {name for parameter in command.params for name in parameter.opts}
    if verb == "study":
        known |= study_options(arguments[0])
    assert {word for word in arguments if word.startswith("--")} <= known


def test_docs_sensor_picture_matches_pattern_drawing() -> None:
    from palpate_pattern.design import PRESETS
    from palpate_pattern.drawing import draw_combined_svg
    from palpate_pattern.pattern import lay_out

    shown = (ROOT / "docs" / "images" / "paper-3x2.svg").read_text(encoding="utf-8")
    assert shown == draw_combined_svg(lay_out(PRESETS["paper-3x2"]))


DOCS = ROOT / "docs"


@pytest.mark.parametrize(
    ("board", "label"),
    [("twin", "`sim-rigid`"), ("mega2560", "Mega 2560, hobby servo"), ("uno", "Uno, hobby servo")],
)
def test_boards_page_table_matches_stored_grasps(board: str, label: str) -> None:
    grasps = json.loads((DOCS / "boards" / f"{board}.json").read_text())["grasps"]
    held = [grasp for grasp in grasps if grasp["outcome"] == "held"]
    assert not any(grasp["damaged"] or grasp["frames_lost"] for grasp in grasps)
    peaks_n = [grasp["peak_force_n"] for grasp in grasps]
    answer_s, grasp_s = (
        np.median([grasp[name] for grasp in held]) for name in ("decision_time_s", "grasp_s")
    )
    row = (
        f"| {label} | {len(held)} of {len(grasps)} | {np.median(peaks_n):.2f} | "
        f"{max(peaks_n):.2f} | {answer_s:.2f} | {grasp_s:.2f} |"
    )
    assert row in (DOCS / "boards.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_reference_tables_agree_with_the_code() -> None:
    assert is_current("generate_tables.py"), "run python docs/generate_tables.py"


def test_architecture_pictures_agree_with_the_packages() -> None:
    assert is_current("generate_architecture.py"), "run python docs/generate_architecture.py"


@pytest.mark.slow
def test_api_pages_agree_with_docstrings_and_have_an_example_for_every_public_name() -> None:
    assert is_current("generate_api.py"), "run python docs/generate_api.py"
    pages = [path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "api").glob("*.md")]
    entries = [entry for page in pages for entry in re.split(r"^::: ", page, flags=re.M)[1:]]
    shown = {entry.split()[0]: entry for entry in entries}
    for name in palpate.__all__:
        entry = shown.get(f"palpate.{name}", "")
        is_error = name in vars(palpate.errors)
        assert is_error or name == "__version__" or ">>>" in entry or "Example: at" in entry, name


@pytest.mark.slow
def test_examples_of_api_pages_run() -> None:
    examples = runpy.run_path(str(ROOT / "docs" / "api_examples.py"))["EXAMPLES"]
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner()
    for names, text in examples:
        assert runner.run(parser.get_doctest(text, {}, names[0], None, None)).failed == 0, names


def is_current(script: str) -> bool:
    """Return whether what a script of docs/ writes is current."""
    check = [sys.executable, f"docs/{script}", "--check"]
    return not subprocess.run(check, cwd=ROOT, stderr=subprocess.DEVNULL, check=False).returncode
