"""A private PostgreSQL server for tests: own folder and user, socket only."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

#: Debian keeps the server's programs out of the path, by version.
DEBIAN = Path("/usr/lib/postgresql")
#: Nothing here has to survive a power cut.
FAST = "-c fsync=off -c full_page_writes=off -c shared_buffers=32MB -c max_connections=40"


def programs() -> Path | None:
    """Return the folder of `initdb` and `pg_ctl`, of the newest version that is installed."""
    found = shutil.which("initdb")
    if found is not None:
        return Path(found).resolve().parent
    versions = sorted(DEBIAN.glob("*/bin/initdb"), key=lambda p: float(p.parts[-3]))
    return versions[-1].parent if versions else None


class PostgresqlProcess:
    """A server that may be stopped and started; a context manager.

    `folder`: of the socket. The user `postgres` needs no password.
    """

    def __init__(self, bin_folder: Path) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="palpate-pg-"))
        self._bin, self._data = bin_folder, str(self.folder / "data")
        # The server refuses to run as root: Debian's package has made a user for it.
        self._user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
        if self._user:
            shutil.chown(self.folder, "postgres")
        access = ("-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync")
        self._run("initdb", "-D", self._data, *access)
        self.start()

    @property
    def url(self) -> str:
        """URL of the database that every server has."""
        return f"postgresql://postgres@/postgres?host={self.folder}&connect_timeout=2"

    def start(self) -> None:
        options = f"{FAST} -c listen_addresses='' -c unix_socket_directories={self.folder}"
        log = str(self.folder / "log")
        self._run("pg_ctl", "-D", self._data, "-w", "-l", log, "-o", options, "start")

    def stop(self) -> None:
        self._run("pg_ctl", "-D", self._data, "-m", "immediate", "stop")

    def __enter__(self) -> PostgresqlProcess:
        return self

    def __exit__(self, *error: object) -> None:
        try:
            self.stop()
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _run(self, program: str, *arguments: str) -> None:
        command = [*self._user, str(self._bin / program), *arguments]
        subprocess.run(command, check=True, capture_output=True, cwd=self.folder, timeout=60)
