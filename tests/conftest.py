"""What every test may use: the command, real recordings, a PostgreSQL server, strict skips."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.commands import Command
from tests.postgresql import PostgresqlProcess, programs

REQUIRE_ALL = os.environ.get("PALPATE_REQUIRE_ALL") == "1"
#: Fixtures that start a program of a system's package: a browser, a compiler for boards, a broker,
#: a database. Tests that use one are left to `make test-all`.
_SYSTEM_FIXTURES = {
    *("browser", "built_library", "firmware_built", "mosquitto_installed"),
    *("postgresql_server", "postgresql_process"),
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that need a program of a system's package."""
    for item in items:
        if _SYSTEM_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.system)


def skip(reason: str) -> None:
    """Skip the test, or fail it where nothing may skip (`PALPATE_REQUIRE_ALL=1`)."""
    if REQUIRE_ALL:
        pytest.fail(f"would skip, and nothing may: {reason}")
    pytest.skip(reason)


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
    from palpate.demo.packhouse import write_packhouse

    folder = tmp_path_factory.mktemp("packhouse") / "demo-packhouse"
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
