"""Command lines as a user types them, and what they print."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import pytest

from palpate.cli import build_app, run


class Printed(NamedTuple):
    """What a command printed on standard output and on standard error."""

    out: str
    err: str

    @property
    def document(self) -> Any:
        """Return the one JSON document of `--json`."""
        return json.loads(self.out, parse_constant=pytest.fail)


def run_palpate(*words: object) -> int:
    """Run a command line in this process; return its status."""
    return run(build_app(), [str(word) for word in words], name="palpate")


class Command:
    """The command `palpate`."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: object, status: int = 0) -> Printed:
        """Run a command line that must end with `status`."""
        printed, ended = self.ended(*words)
        assert ended == status, printed
        return printed

    def ended(self, *words: object) -> tuple[Printed, int]:
        """Run a command line; return what it printed and its status."""
        self._capsys.readouterr()
        status = run_palpate(*words)
        return Printed(*self._capsys.readouterr()), status

    def refused(self, *words: object, status: int = 2) -> str:
        """Run a command line that must end with exactly one line of error; return it."""
        out, err = self(*words, status=status)
        assert out == ""
        assert err.count("\n") == 1, err
        return err
