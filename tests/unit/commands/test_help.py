"""Help of every verb: an example, placeholders in words, nothing of Python's types."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from palpate.cli import GROUPS, VERBS, build_app, run


@pytest.mark.parametrize(
    "verb", [verb for verb in VERBS if verb not in ("study", "bench", "calibrate")]
)
def test_options_have_placeholders_in_words(
    verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert run(build_app(), [verb, "--help"], name="palpate") == 0
    options = capsys.readouterr().out.split("Options", 1)[1]
    assert "--help" in options
    assert not re.search(r"<(bool|int|float|str|path|list)", options)


def test_the_first_page_groups_the_verbs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert run(build_app(), ["--help"], name="palpate") == 0
    page = capsys.readouterr().out
    places = [page.index(f" {heading} ") for heading in GROUPS]
    assert places == sorted(places)
    assert "Example" not in page
    assert max(map(len, page.splitlines())) <= 80


def test_it_runs_as_a_module() -> None:
    told = subprocess.run(
        [sys.executable, "-m", "palpate", "--version"], capture_output=True, text=True
    )
    assert told.returncode == 0
    assert told.stdout.startswith("palpate ")
