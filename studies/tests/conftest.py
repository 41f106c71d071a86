"""The folder of real recordings, and studies run as the command line runs them."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from tests.conftest import real_data

from palpate.cli import build_app, run

__all__ = ["document", "real_data", "refusal"]


@pytest.fixture
def document(capsys: pytest.CaptureFixture[str]) -> Callable[..., Any]:
    """Return what gives the JSON of `palpate study` with some words."""

    def ran(*words: object) -> Any:
        assert run(build_app(), ["study", *map(str, words), "--json"], name="palpate") == 0
        return json.loads(capsys.readouterr().out)

    return ran


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return what gives the one line in which `palpate study` refuses some words."""

    def ran(*words: object) -> str:
        assert run(build_app(), ["study", *map(str, words)], name="palpate") == 2
        output = capsys.readouterr()
        assert output.out == ""
        (line,) = output.err.strip().splitlines()
        return line

    return ran
