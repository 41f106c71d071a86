"""PostgreSQL connection with a time limit for each answer.

The server's own time limits have no effect if the server process hangs while its operating system
still acknowledges packets. Each wait is therefore limited by the client.
"""

from __future__ import annotations

import os
import socket
import threading
from contextlib import suppress
from typing import Any

import psycopg

#: Time limit of an answer, seconds; longer than the server's lock timeout.
ANSWER_S = 15.0


class TimeLimitedConnection(psycopg.Connection[Any]):
    """A connection that closes if an answer exceeds the time limit."""

    def wait(self, *args: Any, **kwargs: Any) -> Any:
        """Wait for the server; shut down the socket after the time limit.

        Raises `psycopg.OperationalError` after the time limit.
        """
        limit = threading.Timer(ANSWER_S, _shut_down, args=(self,))
        limit.daemon = True
        limit.start()
        try:
            return super().wait(*args, **kwargs)
        finally:
            limit.cancel()


def _shut_down(connection: TimeLimitedConnection) -> None:
    # Use a duplicate, because the library closes the original descriptor.
    with (
        suppress(OSError, psycopg.Error),
        socket.socket(fileno=os.dup(connection.pgconn.socket)) as copy,
    ):
        copy.shutdown(socket.SHUT_RDWR)
