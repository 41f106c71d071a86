"""Fixtures for tests on the simulated board: built firmware and simulator."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from tests.conftest import skip


@pytest.fixture(scope="session")
def firmware_built() -> None:
    """Build the firmware and its simulator; skip if their tools are missing."""
    if shutil.which("avr-g++") is None or not Path("/usr/include/simavr").is_dir():
        skip("gcc-avr, avr-libc, binutils-avr, libsimavr-dev and libelf-dev are needed")
    root = Path(__file__).resolve().parents[2]
    for folder in ("firmware", "firmware/sim"):
        subprocess.run(["make", "-s", "-C", str(root / folder)], check=True, capture_output=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test of this folder slow, as each starts a browser, board or broker."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.slow)
