"""The commands of the documentation's pages, and the test that runs them.

A page is a story: its blocks run in order, in one folder and one Python namespace. A module that
imports the test says with a fixture `page` which page it runs.
"""

from __future__ import annotations

import os
import re
import runpy
import shlex
import shutil
import sys
from pathlib import Path

import pytest
from tests.commands import run_palpate

ROOT = Path(__file__).resolve().parents[1]
#: A comment before a block says that its commands exit otherwise than with 0.
BLOCK = re.compile(
    r"^(?:<!-- exit (?P<status>\d) -->\n)?```(?P<kind>\w+)\n(?P<text>.*?)^```", re.M | re.S
)


def blocks(page: str) -> list[tuple[str, int, str]]:
    """Return kind, exit status and text of a page's blocks."""
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    return [(m["kind"], int(m["status"] or 0), m["text"]) for m in BLOCK.finditer(text)]


def run_line(line: str) -> int:
    """Run a line of a shell; return its exit status."""
    program, *arguments = shlex.split(line, comments=True)
    if program == "cd":
        os.chdir(arguments[0])
        return 0
    if program == "palpate":
        return run_palpate(*arguments)
    assert program == "python", f"no idea how to run {line!r}"
    sys.argv = arguments
    script = ROOT / arguments[0]
    # As `python FILE` does, so that a script finds its neighbours.
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(script.parent))
        runpy.run_path(str(script), run_name="__main__")
    return 0


@pytest.mark.slow
def test_commands_of_page_run(
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["palpate"])
    names: dict[str, object] = {}
    for kind, status, text in blocks(page):
        if kind == "python":
            exec(compile(text, f"docs/{page}.md", "exec", dont_inherit=True), names)
        if kind == "sh":
            for line in text.splitlines():
                if line == "palpate demo packhouse":  # run once, by the README's test
                    shutil.copytree(request.getfixturevalue("packhouse"), "demo-packhouse")
                    continue
                found = run_line(line)
                assert found == status, f"{line}: exit status {found}"
    error = capsys.readouterr().err
    assert "Traceback" not in error, error
