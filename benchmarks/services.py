"""A private PostgreSQL server and MQTT broker that can be stopped and started, or frozen."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from processes import list_tree

#: Debian's place of the server programs, which are not on the path.
DEBIAN = Path("/usr/lib/postgresql")


class Database:
    """A PostgreSQL server with its durable defaults on a Unix socket."""

    def __init__(self, folder: Path) -> None:
        versions = sorted(DEBIAN.glob("*/bin"), key=lambda path: -float(path.parent.name))
        if not versions:
            sys.exit("PostgreSQL is missing; install it, such as Debian's package `postgresql`")
        self._programs, self._folder = versions[0], folder
        # PostgreSQL refuses to run as root.
        self._user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
        if self._user:
            shutil.chown(folder, "postgres")
        self._run("initdb", "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C")
        self.url = f"postgresql://postgres@/postgres?host={folder}"

    def _run(self, program: str, *arguments: str, check: bool = True) -> None:
        command = [*self._user, str(self._programs / program), "-D", str(self._folder / "data")]
        subprocess.run([*command, *arguments], check=check, capture_output=True, cwd=self._folder)

    def start(self) -> None:
        options = f"-c listen_addresses='' -c unix_socket_directories={self._folder}"
        options += " -c max_connections=120"
        self._run("pg_ctl", "-w", "-l", str(self._folder / "log"), "-o", options, "start")

    def processes(self) -> list[int]:
        return list_tree(int((self._folder / "data" / "postmaster.pid").read_text().split()[0]))

    def stop(self) -> None:
        """Stop as in a power failure; stopping again has no effect."""
        self._run("pg_ctl", "-m", "immediate", "stop", check=False)


class Broker:
    """Mosquitto on a free port of this machine, without a password."""

    def __init__(self, folder: Path) -> None:
        program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        if program is None:
            sys.exit("mosquitto is missing; install it, such as Debian's package `mosquitto`")
        self.port = free_port()
        settings = folder / "mosquitto.conf"
        # Sessions of consumers survive a restart.
        settings.write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\n"
            f"persistence true\npersistence_location {folder}/\n"
        )
        if os.geteuid() == 0:
            settings.write_text(settings.read_text() + "user root\n")
        self._command = [program, "-c", str(settings)]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        self._process = subprocess.Popen(self._command, stderr=subprocess.DEVNULL)
        wait_for_port(self.port)

    def processes(self) -> list[int]:
        return [] if self._process is None else [self._process.pid]

    def stop(self) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.wait()


def freeze(service: Database | Broker) -> None:
    """Stop answering without closing a connection, as with an unplugged cable."""
    for pid in service.processes():
        os.kill(pid, signal.SIGSTOP)


def thaw(service: Database | Broker) -> None:
    """Continue after `freeze`."""
    for pid in service.processes():
        os.kill(pid, signal.SIGCONT)


@contextmanager
def run_service(service: Database | Broker) -> Iterator[None]:
    """Run a service until the end of the block."""
    service.start()
    try:
        yield
    finally:
        service.stop()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def wait_for_port(port: int, *, seconds: float = 60.0) -> None:
    """Wait until a server of this machine listens."""
    until_s = time.monotonic() + seconds
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
        except OSError:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.05)
        else:
            return
