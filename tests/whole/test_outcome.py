"""Failures of any verb: one line and an exit status, but no traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from io import StringIO

import pytest
import typer
from tests.commands import Command

from palpate.cli import lazy_group, run

SCRIPT = (sys.executable, "-c", "from palpate.cli import main; main()")
CARD = ("grasp", "--seed", "1", "--object", "rigid-block", "--rate-hz", "15")


@pytest.mark.parametrize(("words", "named"), [((), "grasp"), (("calibrate",), "rest")])
def test_run_without_a_verb_or_step_prints_the_help(
    words: tuple[str, ...], named: str, palpate: Command
) -> None:
    captured = palpate(*words, status=2)
    assert named in captured.out
    assert captured.err == ""


@pytest.mark.slow
def test_output_in_ascii_encoding_replaces_characters_with_question_marks() -> None:
    done = subprocess.run(
        [*SCRIPT, *CARD],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        check=False,
    )
    assert done.stderr == b""
    assert done.returncode == 0
    shown = done.stdout.decode("ascii")
    assert "Grip force, N" in shown
    assert "?" in shown
    assert len({len(line) for line in shown.splitlines()}) == 1


def test_run_full_disk_is_reported_in_one_line() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*SCRIPT, "study", "--list"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 3
    assert done.stderr.startswith("palpate: No space left on device; free some space")
    assert done.stderr.count("\n") == 1


class CtrlC(StringIO):
    def readline(self, size: int | None = -1, /) -> str:
        raise KeyboardInterrupt


def deny() -> None:
    raise PermissionError(13, "Permission denied", "out.csv")


@pytest.mark.parametrize(
    ("act", "stdin", "status", "message"),
    [
        (deny, StringIO(), 2, "out.csv: Permission denied; change the permissions"),
        (lambda: typer.prompt("loads", err=True), StringIO(), 2, "no answer on standard input"),
        (lambda: typer.prompt("loads", err=True), CtrlC(), 130, "stopped"),
    ],
)
def test_run_failure_while_acting_is_reported_with_its_status(
    act: Callable[[], object],
    stdin: StringIO,
    status: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stdin", stdin)
    app = typer.Typer()
    app.command()(act)
    assert run(app, [], name="palpate") == status
    assert f"palpate: {message}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "folder"),
    [
        ("bench settling", "packages/studies"),
        ("archive settle archive", "packages/archive"),
        ("grasp --item A17", "packages/station"),
        ("live --rig sim-rigid --foxglove", "packages/foxglove"),
        ("export run.mcap --lerobot grasps", "packages/lerobot-dataset"),
        ("export run.mcap --rerun run.rrd", "packages/rerun"),
    ],
)
def test_missing_package_names_what_to_install(
    command: str, folder: str, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lazy_group, "entry_points", lambda *, group: ())
    error = palpate.refused(*command.split())
    assert error.endswith(f"in a copy of the source: pip install ./{folder}\n")


def test_run_closed_output_pipe_exits_with_0() -> None:
    with subprocess.Popen(
        [*SCRIPT, "study", "--list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
