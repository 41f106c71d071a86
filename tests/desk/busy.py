"""Processes that keep the processors busy until the bench ends, even if it dies."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_SPIN = "import os\nowner = os.getppid()\nwhile os.getppid() == owner:\n  sum(range(100_000))"


@contextmanager
def keep_busy(count: int) -> Iterator[None]:
    """Run `count` busy processes."""
    spinning = [subprocess.Popen([sys.executable, "-c", _SPIN]) for _ in range(count)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()
