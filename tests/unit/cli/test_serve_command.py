"""`palpate serve`: refused options, and imports at the start."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest
from tests.commands import Command


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (["--rig", "nowhere.toml"], 2, "no rig 'nowhere.toml'; available: sim-rigid"),
        (["--rig", "mujoco", "--rate-hz", "15"], 2, "--rate-hz is for sim-rigid"),
        (["--object", "moon"], 2, "no simulated object 'moon'; available: ecoflex-10"),
        (["--host", "0.0.0.0"], 2, "set --token"),
        (["--host", "[::]"], 2, "--host :: allows other machines to move the gripper"),
        (["--damage", "no.json"], 2, "damage file no.json: No such file or directory"),
        (["--token", "short"], 2, "the token has 5 characters; use at least 8"),
        (["--store", "none/items.sqlite"], 2, "the folder none does not exist; create it first"),
        (["--folder", f"{__file__}/data"], 2, "test_serve_command.py is not a writable folder"),
    ],
)
def test_serve_invalid_options_are_refused_in_one_line(
    options: list[str],
    status: int,
    message: str,
    palpate: Command,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in palpate.refused("serve", *options, status=status)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_serve_taken_port_is_reported(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-c", "from palpate.cli import main; main()", "serve"]
        ended = subprocess.run(
            [*command, "--port", port], capture_output=True, text=True, cwd=tmp_path, check=False
        )
    assert ended.returncode == 3
    assert f"127.0.0.1:{port}: Address already in use" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_serve_missing_extra_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    for name in ("palpate.dashboard.server", "palpate.dashboard.access"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    for name in ("starlette", "starlette.datastructures", "fastapi", "nicegui", "uvicorn"):
        monkeypatch.setitem(sys.modules, name, None)
    assert "pip install 'palpate[dashboard]'" in palpate.refused("serve")
