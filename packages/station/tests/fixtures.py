"""What every test may use of the station: the demo packhouse and a PostgreSQL server."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from packages.station.tests.postgresql import PostgresqlProcess, programs
from tests.fixtures import skip


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
