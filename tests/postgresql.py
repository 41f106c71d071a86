"""A private PostgreSQL server for the tests: own folder, own user, reached by a socket alone."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def running_server(bin_folder: Path) -> Iterator[str]:
    """Yield the socket's folder of a running server, whose user `postgres` needs no password."""
    folder = Path(tempfile.mkdtemp(prefix="palpate-pg-"))
    # The server refuses to run as root: Debian's package has made a user for it.
    other_user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
    if other_user:
        shutil.chown(folder, "postgres")
    data = folder / "data"

    def run(program: str, *arguments: str) -> None:
        command = [*other_user, str(bin_folder / program), *arguments]
        subprocess.run(command, check=True, capture_output=True, cwd=folder, timeout=60)

    try:
        run(
            "initdb",
            "-D",
            str(data),
            "-U",
            "postgres",
            "-A",
            "trust",
            "-E",
            "UTF8",
            "--locale=C",
            "--no-sync",
        )
        options = f"{FAST} -c listen_addresses='' -c unix_socket_directories={folder}"
        run("pg_ctl", "-D", str(data), "-w", "-l", str(folder / "log"), "-o", options, "start")
        try:
            yield str(folder)
        finally:
            run("pg_ctl", "-D", str(data), "-m", "immediate", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
