"""The port of the server, which accepts a STOP also during a flood of connections."""

from __future__ import annotations

import socket
import time
from collections import deque
from typing import Any

from palpate.errors import DeviceError

#: Paths of the stop requests, for the page and for the API.
STOP_PATHS = frozenset({"/stop", "/api/stop"})
_STOP_STARTS = tuple(f"POST {path} ".encode() for path in STOP_PATHS)
#: Connections served per second; of further ones, only stops are. A browser opens six.
MAX_NEW_CONNECTIONS = 100
#: Connections refused at a time, so that the event loop works in between.
_MAX_REFUSED = 256


class StopListener(socket.socket):
    """A listening TCP socket with a limit of new connections a second, except for stops.

    A connection is refused here before the server's event loop makes a transport and a protocol of
    it, so that a STOP does not wait behind those of clients that reconnect without pause.
    """

    def __init__(self, family: socket.AddressFamily) -> None:
        super().__init__(family)
        self._served_s = deque[float](maxlen=MAX_NEW_CONNECTIONS)

    def accept(self) -> tuple[socket.socket, Any]:
        """Return the next connection that is served, and its address.

        Raises `BlockingIOError` if there is none now.
        """
        for _ in range(_MAX_REFUSED):
            connection, address = super().accept()
            if self._is_served(connection):
                return connection, address
            connection.close()
        raise BlockingIOError

    def _is_served(self, connection: socket.socket) -> bool:
        connection.setblocking(False)
        try:
            start = connection.recv(max(map(len, _STOP_STARTS)), socket.MSG_PEEK)
        except BlockingIOError:
            start = b""
        except OSError:
            return False
        if start.startswith(_STOP_STARTS):
            return True
        now_s = time.monotonic()
        if len(self._served_s) == self._served_s.maxlen and now_s - self._served_s[0] < 1.0:
            return False
        self._served_s.append(now_s)
        return True


def bind_port(host: str, port: int) -> StopListener:
    """Bind the port and listen, before any device is opened.

    Raises
    ------
    DeviceError
        If the port can't be bound.
    """
    listening = StopListener(socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # Linux then hands over connections with their first bytes. Elsewhere a STOP whose bytes come
    # later is refused during a flood, and repeated by the page.
    if hasattr(socket, "TCP_DEFER_ACCEPT"):
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, 1)
    try:
        listening.bind((host, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise DeviceError(
            f"{host}:{port}: {error.strerror}; is palpate serve already running? "
            "Choose another --port"
        ) from error
    return listening
