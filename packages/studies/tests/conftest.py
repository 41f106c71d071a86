"""Fixtures: the folder of real recordings, and studies run through the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from tests.fixtures import real_data

from palpate.cli import build_app, run

__all__ = ["document", "real_data", "refusal"]


@pytest.fixture
def document(capsys: pytest.CaptureFixture[str]) -> Callable[..., Any]:
    """Return a function that runs `palpate study` with arguments and returns its JSON."""

    def run_study(*words: object) -> Any:
        assert run(build_app(), ["study", *map(str, words), "--json"], name="palpate") == 0
        return json.loads(capsys.readouterr().out)

    return run_study


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return a function that runs `palpate study` and returns its one-line refusal."""

    def run_study(*words: object) -> str:
        assert run(build_app(), ["study", *map(str, words)], name="palpate") == 2
        output = capsys.readouterr()
        assert output.out == ""
        (line,) = output.err.strip().splitlines()
        return line

    return run_study
