"""`palpate serve`: refused options, and imports at the start."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest


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
