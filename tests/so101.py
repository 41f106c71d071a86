"""`palpate demo so101` as a process, as a user starts it in another terminal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def run_so101(folder: Path) -> Iterator[Path]:
    """Run the demo in a folder; yield the demo's own folder once its ports are open.

    The simulation is in real time, which a process without a claim to a processor can't keep.
    """
    if sys.platform == "linux" and os.sched_getscheduler(0) == os.SCHED_IDLE:
        pytest.skip("grasps in real time, and these tests run at idle priority")
    command = [sys.executable, "-c", "from palpate.cli import main; main()", "demo", "so101"]
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as demo:
        try:
            assert demo.stdout is not None
            assert any("SIMULATED" in line for line in iter(demo.stdout.readline, ""))
            yield folder / "demo-so101"
        finally:
            demo.send_signal(signal.SIGTERM)
            demo.wait(timeout=30.0)
