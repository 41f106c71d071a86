"""The core without the modules and functions that only Unix systems have."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

#: As on Windows. The standard library itself still has its copies where it needs them.
PROGRAM = """
import importlib, os, pkgutil, signal, subprocess, sys
import _posixsubprocess  # the parent's own

for name in ("grp", "pwd", "termios", "resource", "tty", "fcntl", "pty"):
    sys.modules[name] = None
for name in ("fdatasync", "openpty", "fork", "forkpty", "pread", "O_CLOEXEC", "O_DIRECTORY"):
    vars(os).pop(name, None)
for name in ("SIGHUP", "SIGQUIT", "SIGXFSZ"):
    vars(signal).pop(name, None)

import palpate
from palpate.cli import build_app, run

# A shared servo line needs pseudo-terminals, and says so.
UNIX = ("palpate.gripper.bus_share", "palpate.demo.so101")
for module in pkgutil.walk_packages(palpate.__path__, "palpate."):
    if not module.name.endswith("__main__") and module.name not in UNIX:
        importlib.import_module(module.name)
for line in open(sys.argv[1]).read().splitlines():
    status = run(build_app(), line.split(), name="palpate")
    assert status == 0, (line, status)
"""


@pytest.mark.slow
def test_core_runs_without_unix_modules(tmp_path: Path) -> None:
    rows = [f"{n / 10:.1f},{600 - 30 * min(n, 20) + 200 / (n + 1):.2f}" for n in range(300)]
    (tmp_path / "press.csv").write_text("\n".join(["time_s,ohm", *rows]))
    commands = [
        "ports",
        "grasp --rig sim-rigid --seed 1 --rate-hz 15 --record grasp.mcap",
        "record run.mcap --rig sim-rigid --duration 1",
        "inspect run.mcap",
        "settle press.csv --out answers.csv",
        "doctor --rig sim-rigid --duration 1",
    ]
    (tmp_path / "commands.txt").write_text("\n".join(commands))
    (tmp_path / "program.py").write_text(PROGRAM)
    ended = subprocess.run(
        [sys.executable, "program.py", "commands.txt"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert (tmp_path / "answers.csv").read_text().count("\n") > 1
