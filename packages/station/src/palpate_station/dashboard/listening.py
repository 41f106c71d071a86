"""The port of the server, which accepts a STOP also during a flood of connections."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from typing import Any

from palpate.errors import DeviceError
from palpate_station.dashboard import front

#: Connections served per second; of further ones, only stops are. A browser opens six.
MAX_NEW_CONNECTIONS = 100
#: Connections that wait to be accepted: as many as Linux allows by default. One beyond them is
#: repeated after a second.
_BACKLOG = 4096
#: Time between two starts of the process that accepts, seconds: if it can't run, not in a loop.
_RESTART_S = 0.5


class FrontedListener(socket.socket):
    """A listening socket whose connections are accepted by another process, see `front`.

    It is the receiving end of that process's channel. An event loop can use it as any other.

    Parameters
    ----------
    listening : socket.socket
        The listening TCP socket, which is closed with this one.
    max_new_connections : int
        Connections a second that are served besides stops.
    """

    def __init__(self, listening: socket.socket, *, max_new_connections: int) -> None:
        received, self._sent = socket.socketpair()
        super().__init__(received.family, received.type, fileno=received.detach())
        self._listening = listening
        self._max_new_connections = max_new_connections
        self._starting, self._closing = threading.Lock(), threading.Event()
        self._process = self._start()
        self._guard = threading.Thread(target=self._keep_running, daemon=True, name="accepting")
        self._guard.start()

    def accept(self) -> tuple[socket.socket, Any]:
        """Return the next connection that is served, and its address.

        Raises `BlockingIOError` if there is none now.
        """
        while True:
            numbers = list[int]()
            if sys.platform != "win32":
                _, numbers, _, _ = socket.recv_fds(self, 1, 1)
            connection = socket.socket(fileno=numbers[0])
            try:
                return connection, connection.getpeername()
            except OSError:
                connection.close()

    def listen(self, backlog: int = 0, /) -> None:
        """Do nothing: the TCP socket listens already."""

    def getsockname(self) -> Any:
        """Return the address of the TCP socket."""
        return self._listening.getsockname()

    def close(self) -> None:
        """End the process and close the port."""
        if not self._closing.is_set():
            with self._starting:
                self._closing.set()
                self._process.kill()
            self._guard.join()
            self._listening.close()
            self._sent.close()
        super().close()

    def _start(self) -> subprocess.Popen[bytes]:
        numbers = (self._listening.fileno(), self._sent.fileno())
        arguments = map(str, (*numbers, self._max_new_connections))
        return subprocess.Popen(
            [sys.executable, "-I", front.__file__, *arguments],
            stdin=subprocess.PIPE,
            pass_fds=numbers,
            start_new_session=True,
        )

    def _keep_running(self) -> None:
        while True:
            with self._process:
                self._process.wait()
            self._closing.wait(_RESTART_S)
            with self._starting:
                if self._closing.is_set():
                    return
                self._process = self._start()


def bind_fault(error: OSError) -> str:
    """Return why an address can't be bound; for a reserved port, what allows it."""
    remedy = " (a port below 1024 requires CAP_NET_BIND_SERVICE, as in examples/palpate.service)"
    return f"{error.strerror}{remedy if isinstance(error, PermissionError) else ''}"


def bind_port(
    host: str, port: int, *, max_new_connections: int = MAX_NEW_CONNECTIONS
) -> socket.socket:
    """Bind the port and listen, before any device is opened.

    Raises
    ------
    DeviceError
        If the port can't be bound.
    """
    listening = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # Linux then hands over connections with their first bytes. Elsewhere a STOP whose bytes come
    # later is refused during a flood, and repeated by the page.
    if hasattr(socket, "TCP_DEFER_ACCEPT"):
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, 1)
    try:
        listening.bind((host, port))
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise DeviceError(
            f"{host}:{port}: {bind_fault(error)}; is palpate serve already running? "
            "Choose another --port"
        ) from error
    # Windows can't pass connections to another process: there the limit is missing.
    return (
        listening
        if sys.platform == "win32"
        else FrontedListener(listening, max_new_connections=max_new_connections)
    )
