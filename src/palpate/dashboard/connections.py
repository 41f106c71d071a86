"""Connections of the server: none stays open without a request, and a new one is always let in."""

from __future__ import annotations

import asyncio
import resource
from typing import ClassVar

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

#: A request is complete this long after its first byte, or after its connection was opened, in
#: seconds (guess): a page on a slow network takes far less.
REQUEST_S = 5.0
#: Connections at most, where a process may have that many files open; half of those if not.
MOST_CONNECTIONS = 1000


class BoundedConnection(HttpToolsProtocol):
    """An HTTP connection that is closed when its request takes too long.

    A server without this can be kept from its viewers by connections on which nothing is sent, or
    a byte now and then: it runs out of files. Beyond the most connections, the one that has been
    silent for longest makes room, so that a STOP always gets in. Web sockets are not counted: they
    have been admitted.
    """

    #: All connections, the one that was silent for longest first.
    _open: ClassVar[dict[BoundedConnection, None]] = {}
    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._expect()
        while len(self._open) > most_connections():
            next(iter(self._open)).drop()

    def data_received(self, data: bytes) -> None:
        """Take a piece of a request."""
        self._expect()
        super().data_received(data)

    def on_message_complete(self) -> None:
        """Stop the clock: the request is here."""
        self._done()
        super().on_message_complete()

    def handle_websocket_upgrade(self) -> None:
        """Hand the connection over."""
        self._forget()
        super().handle_websocket_upgrade()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._forget()
        super().connection_lost(exc)

    def drop(self) -> None:
        """Close the connection without a word."""
        self._forget()
        self.transport.abort()

    def _expect(self) -> None:
        """Start the clock of a request, unless it runs."""
        self._open.pop(self, None)
        self._open[self] = None
        if self._late is None:
            self._late = self.loop.call_later(REQUEST_S, self.drop)

    def _forget(self) -> None:
        self._done()
        self._open.pop(self, None)

    def _done(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


def most_connections() -> int:
    """Return how many connections are left open: others of the process need files too."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MOST_CONNECTIONS if soft < 0 else min(MOST_CONNECTIONS, soft // 2)
