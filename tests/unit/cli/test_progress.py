"""The progress bar, which appears only on a terminal."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest


def run_on_terminal(arguments: list[str], *, folder: Path) -> tuple[str, bytes]:
    """Run Python with a terminal for standard error; return both outputs."""
    terminal, end = pty.openpty()
    done = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "80"},
        stdout=subprocess.PIPE,
        stderr=end,
        text=True,
    )
    os.close(end)
    shown = b""
    while True:
        try:
            shown += os.read(terminal, 4096)
        except OSError:  # the other end is closed: the command has ended
            break
    os.close(terminal)
    out = done.stdout.read()
    done.stdout.close()
    assert done.wait() == 0, shown
    return out, shown


@pytest.mark.slow
def test_settle_for_a_program_shows_no_progress_bar(tmp_path: Path) -> None:
    rows = [f"a,{k / 10},{99 - k / 50}" for k in range(210)]
    (tmp_path / "holds.csv").write_text("\n".join(["hold_id,time_s,value", *rows]))
    settle = ["-m", "palpate", "settle", "holds.csv", "--json"]
    out, shown = run_on_terminal(settle, folder=tmp_path)
    assert b"settling" not in shown
    assert json.loads(out)["rows"]


def test_progress_leaves_printed_output_on_stdout(tmp_path: Path) -> None:
    script = (
        "from palpate.cli.output import progress\n"
        "with progress('counting') as show:\n"
        "    print('answer')\n"
    )
    out, shown = run_on_terminal(["-c", script], folder=tmp_path)
    assert b"counting" in shown
    assert out == "answer\n"
    assert b"answer" not in shown
