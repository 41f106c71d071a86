"""A connection to PostgreSQL with a time-out, even for a frozen back end.

The server's own time limits do not help where the server itself hangs while the system runs
acknowledging what is sent to it. So each wait is limited on this side.
"""

from __future__ import annotations

import os
import socket
import threading
from contextlib import suppress
from typing import Any

import psycopg

#: Longer than the server lets a writer wait for a lock.
ANSWER_S = 15.0


class AnsweringConnection(psycopg.Connection[Any]):
    """A connection that is lost once an answer takes too long."""

    def wait(self, *args: Any, **kwargs: Any) -> Any:
        """Wait for the server; after the time limit, shut the socket and fail.

        Raises `psycopg.OperationalError` if no answer came in time.
        """
        limit = threading.Timer(ANSWER_S, _shut_down, args=(self,))
        limit.daemon = True
        limit.start()
        try:
            return super().wait(*args, **kwargs)
        finally:
            limit.cancel()


def _shut_down(connection: AnsweringConnection) -> None:
    # Of a copy: the descriptor itself is the library's to close.
    with (
        suppress(OSError, psycopg.Error),
        socket.socket(fileno=_duplicate_socket(connection)) as copy,
    ):
        copy.shutdown(socket.SHUT_RDWR)


def _duplicate_socket(connection: AnsweringConnection) -> int:
    return os.dup(connection.pgconn.socket)
