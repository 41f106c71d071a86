"""`palpate serve`: refused options, and imports at the start."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_serve_unlearned_class_and_taken_port_are_reported(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-c", "from palpate.cli import main; main()", "serve"]
        rules = tmp_path / "rules.toml"
        rules.write_text('default = "x"\n[[rule]]\nbin = "y"\nclass = "avocadoo"\n')
        ended = subprocess.run(
            [*command, "--port", port, "--rules", str(rules), "--rig", "sim-rigid"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            check=False,
        )
    assert ended.returncode == 3
    # Without labelled items no item can have this class.
    assert f"{rules} line 2: class 'avocadoo' has fewer than 3 labelled items" in ended.stderr
    assert f"127.0.0.1:{port}: Address already in use" in ended.stderr
    assert "Traceback" not in ended.stderr
