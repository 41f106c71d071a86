"""`palpate live --rerun` on the twin, with Rerun's own server, which saves what it receives."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun.chunk", reason="needs the Rerun SDK with its reader of chunks")

from packages.rerun.tests.rrd_files import read_rrd, series
from tests.commands import Command

WAIT_S = 30.0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(port: int) -> None:
    end_s = time.monotonic() + WAIT_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
        except OSError:
            assert time.monotonic() < end_s, "the server of Rerun did not start"
            time.sleep(0.05)
        else:
            return


# The server that saves is stopped, and then writes no index.
@pytest.mark.filterwarnings("ignore:RRD file has no footer")
@pytest.mark.slow
def test_live_rerun_sends_every_frame_with_its_force(palpate: Command, tmp_path: Path) -> None:
    saved, port = tmp_path / "live.rrd", free_port()
    command = [sys.executable, "-m", "rerun", "--port", str(port), "--save", str(saved)]
    # The command starts another process: both are of one group.
    server = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        wait_for(port)
        address = f"127.0.0.1:{port}"
        palpate(
            *("live", "--rig", "sim-rigid", "--force", "--duration", "1.5"),
            *("--rerun", address),
        )
    finally:
        os.killpg(server.pid, signal.SIGTERM)
        server.wait(timeout=WAIT_S)
    entities = read_rrd(saved)
    force, times_ns = entities["force"], np.sort(entities["force"]["sensor_time"])
    assert len(times_ns) > 100
    # No frame is missing between two that were sent: the twin scans each 4 ms.
    assert set(np.diff(times_ns).tolist()) == {4_000_000}
    assert len(force["wall_time"]) == len(times_ns)
    assert np.isfinite(series(force)).all()
    assert "SIMULATED" in entities["source"]["TextDocument:text"][0][0]


def test_live_rerun_without_a_viewer_names_how_to_start_one(palpate: Command) -> None:
    port = free_port()
    error = palpate.refused("live", "--rig", "sim-rigid", "--rerun", f"127.0.0.1:{port}")
    assert f"rerun --port {port}" in error
