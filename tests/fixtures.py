"""What every test may use: the command, real recordings, the built firmware, strict skips."""

from __future__ import annotations

import os
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings
from tests.commands import Command

if TYPE_CHECKING:
    from palpate.calibration import Calibration
    from palpate.twin.world import GripperKind

# A busy machine is slow; no property depends on its speed.
settings.register_profile("any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any speed")

REQUIRE_ALL = os.environ.get("PALPATE_REQUIRE_ALL") == "1"
#: Fixtures that start a program of a system's package: a browser, a compiler for boards, a broker,
#: a database. Tests that use one are left to `make test-all`.
_SYSTEM_FIXTURES = {
    *("browser", "built_library", "firmware_built", "mosquitto_installed"),
    *("postgresql_server", "postgresql_process"),
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that need a program of a system's package; a plain `pytest` omits them."""
    for item in items:
        if _SYSTEM_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.system)
        if item.get_closest_marker("system"):
            item.add_marker(pytest.mark.slow)


def skip(reason: str) -> None:
    """Skip the test, or fail it where nothing may skip (`PALPATE_REQUIRE_ALL=1`)."""
    if REQUIRE_ALL:
        pytest.fail(f"would skip, and nothing may: {reason}")
    pytest.skip(reason)


@cache
def calibrate_once(
    *, seed: int, level: str, apart_from: str, kind: GripperKind = "rigid"
) -> Calibration:
    """Return a calibration of the twin, the same object to each test that asks for it."""
    from palpate.twin.rig import calibrate_twin

    return calibrate_twin(seed=seed, level=level, apart_from=apart_from, kind=kind)


@pytest.fixture
def palpate(capsys: pytest.CaptureFixture[str]) -> Command:
    """Return the command `palpate`, run in this process."""
    return Command(capsys)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real recordings (never part of this project)."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("PALPATE_REAL_DATA", default))
    if not folder.is_dir():
        skip(f"no real recordings at {folder}; set PALPATE_REAL_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def firmware_built() -> None:
    """Build the firmware and its simulator; skip if their tools are missing."""
    if shutil.which("avr-g++") is None or not Path("/usr/include/simavr").is_dir():
        skip("gcc-avr, avr-libc, binutils-avr, libsimavr-dev and libelf-dev are needed")
    root = Path(__file__).resolve().parents[1]
    for folder in ("firmware", "firmware/sim"):
        subprocess.run(["make", "-s", "-C", str(root / folder)], check=True, capture_output=True)
