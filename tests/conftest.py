"""What every test may use: the command, real recordings, a PostgreSQL server, strict skips."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings
from tests.commands import Command
from tests.postgresql import PostgresqlProcess, programs

if TYPE_CHECKING:
    from palpate.sensor.calibration import Calibration
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
    from palpate.rig.simulated import calibrate_twin

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
def packhouse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that `palpate demo packhouse` writes; copy what a test changes."""
    from palpate_station.demo_packhouse import write_packhouse

    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent  # one for all processes
    folder = shared / "demo-packhouse"
    with (shared / "demo-packhouse.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "by-size.toml").exists():
            write_packhouse(folder)
    return folder


@pytest.fixture(scope="session")
def postgresql_server() -> Iterator[str]:
    """Start a private PostgreSQL server; return the folder of its socket."""
    found = programs()
    if found is None:
        skip("no PostgreSQL server; install it (Debian: postgresql)")
    else:
        with PostgresqlProcess(found) as server:
            yield str(server.folder)


@pytest.fixture
def postgresql_url(
    postgresql_server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    """Make an empty schema on the private server; return a URL that leads into it."""
    import psycopg

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    name = f"store_{os.urandom(6).hex()}"
    server = f"postgresql://postgres@/postgres?host={postgresql_server}"
    with psycopg.connect(server, autocommit=True) as connection:
        connection.execute(f"CREATE SCHEMA {name}".encode())
    yield f"{server}&options=-csearch_path%3D{name}"
    with psycopg.connect(server, autocommit=True) as connection:
        connection.execute(f"DROP SCHEMA {name} CASCADE".encode())
