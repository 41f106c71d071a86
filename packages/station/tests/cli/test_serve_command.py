"""`palpate serve`: refused options, and imports at the start."""

from __future__ import annotations

import fcntl
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from tests.commands import Command


@pytest.mark.slow
def test_serve_unlearned_class_and_taken_port_are_reported(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-c", "from palpate.cli import main; main()", "serve"]
        rules = tmp_path / "rules.toml"
        rules.write_text(
            'default = "x"\n[[rule]]\nbin = "y"\nclass = "avocadoo"\n'
            '[[rule]]\nbin = "z"\nripeness = ["ripe", "ripee"]\n'
        )
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
    assert f"{rules} line 5: ripeness 'ripee' is no stage" in ended.stderr
    assert "'ripe'" not in ended.stderr
    assert f"127.0.0.1:{port}: Address already in use" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.slow
def test_serve_in_the_folder_of_another_server_ends_with_one_line(tmp_path: Path) -> None:
    with (tmp_path / ".serve.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        command = [sys.executable, "-c", "from palpate.cli import main; main()", "serve"]
        ended = subprocess.run(
            [*command, "--port", "0", "--rig", "sim-rigid", "--folder", str(tmp_path)],
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )
    assert ended.returncode == 3
    assert f"--folder {tmp_path}: another palpate serve uses it" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    ("protocols", "fault"),
    [
        (("--port", "18101", "--modbus", "18101"), "--modbus 18101: --port has port 18101 too"),
        (("--opcua", "18111", "--modbus", "127.0.0.1:18111"), "--opcua has port 18111 too"),
    ],
)
def test_serve_with_one_port_for_two_protocols_is_refused(
    palpate: Command, protocols: tuple[str, ...], fault: str
) -> None:
    refused = palpate("serve", *protocols, "--rig", "sim-rigid", status=2)
    assert fault in refused.err
