"""Connections with room for a STOP, the pages' own loop, and their address."""

from __future__ import annotations

import asyncio
import resource
import socket
import sys
from collections.abc import Awaitable
from ipaddress import ip_address
from threading import Thread
from typing import ClassVar, TypeVar

from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

_T = TypeVar("_T")
#: A request is complete this long after its first byte, or after its connection was opened, in
#: seconds (guess): a page on a slow network takes far less.
REQUEST_TIMEOUT_S = 5.0
#: Connections at most, where a process may have that many files open; half of those if not.
MAX_CONNECTIONS = 1000


class BoundedConnection(HttpToolsProtocol):
    """An HTTP connection that is closed when its request takes too long.

    A server without this can be kept from its viewers by connections on which nothing is sent, or
    a byte now and then: it runs out of files. Beyond the most connections, the one that has been
    silent for longest makes room, so that a STOP always gets in. Web sockets are not counted: they
    have been admitted.
    """

    #: All connections, the one that was silent for longest first.
    _open: ClassVar[dict[BoundedConnection, None]] = {}
    _timeout: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._start_timeout()
        while len(self._open) > connection_limit():
            next(iter(self._open)).drop()

    def data_received(self, data: bytes) -> None:
        """Take a piece of a request."""
        self._start_timeout()
        super().data_received(data)

    def on_message_complete(self) -> None:
        """Stop the clock: the request is here."""
        self._cancel_timeout()
        super().on_message_complete()

    def handle_websocket_upgrade(self) -> None:
        """Hand the connection over."""
        self._remove()
        super().handle_websocket_upgrade()

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection."""
        self._remove()
        super().connection_lost(exc)

    def drop(self) -> None:
        """Close the connection without a word."""
        self._remove()
        self.transport.abort()

    def _start_timeout(self) -> None:
        """Start the clock of a request, unless it runs."""
        self._open.pop(self, None)
        self._open[self] = None
        if self._timeout is None:
            self._timeout = self.loop.call_later(REQUEST_TIMEOUT_S, self.drop)

    def _remove(self) -> None:
        self._cancel_timeout()
        self._open.pop(self, None)

    def _cancel_timeout(self) -> None:
        if self._timeout is not None:
            self._timeout.cancel()
            self._timeout = None


def connection_limit() -> int:
    """Return how many connections are left open: others of the process need files too."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MAX_CONNECTIONS if soft < 0 else min(MAX_CONNECTIONS, soft // 2)


#: Python lets another thread run this often, seconds. While a page was being built, an answer of a
#: direct path took 13.8 ms (p99 41) at the usual 5 ms, and 1.3 ms (p99 18) at this; the median of
#: 150, two loaded cores.
_THREAD_SWITCH_S = 0.0005


#: Where files lie that stay as they are.
_STATIC_PATHS = ("/static/", "/_nicegui/")


class FilesGzip(GZipMiddleware):
    """Compresses files of the page, but neither polled documents nor downloads."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        is_file = scope["type"] == "http" and scope["path"].startswith(_STATIC_PATHS)
        await (super().__call__ if is_file else self.app)(scope, receive, send)


class LoopThread:
    """An event loop on a thread of its own, from `__enter__` to `__exit__`."""

    def __init__(self, name: str) -> None:
        self._runner = asyncio.Runner(loop_factory=asyncio.new_event_loop)
        self._loop, self._closed = self._runner.get_loop(), asyncio.Event()
        self._thread = Thread(target=self._runner.run, args=(self._closed.wait(),), name=name)

    def __enter__(self) -> LoopThread:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._loop.call_soon_threadsafe(self._closed.set)
        self._thread.join()
        self._runner.close()

    async def run(self, work: Awaitable[_T]) -> _T:
        """Run a coroutine on the loop, and wait for it from another one."""
        return await run_on(self._loop, work)


async def run_on(loop: asyncio.AbstractEventLoop, work: Awaitable[_T]) -> _T:
    """Wait for a coroutine on the loop of another thread."""

    async def finish() -> _T:
        return await work

    return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(finish(), loop))


class AppThread:
    """Runs an ASGI application on the event loop of a thread, except for some paths.

    The server's own loop then has nothing to do but to read requests, check who sent them, and
    answer the direct paths: a page that is built or a slow disk holds up the other loop alone.

    Parameters
    ----------
    app : ASGI application
        The application; its handlers of `direct` run on the server's loop.
    direct : frozenset of str
        Paths that are answered at once.
    """

    def __init__(self, app: ASGIApp, *, direct: frozenset[str]) -> None:
        self._app, self._direct = app, direct
        self._thread = LoopThread("pages")

    def __enter__(self) -> AppThread:
        self._previous_switch_s = sys.getswitchinterval()
        sys.setswitchinterval(_THREAD_SWITCH_S)
        self._thread.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        sys.setswitchinterval(self._previous_switch_s)
        self._thread.__exit__(*error)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a direct path here, and everything else in the thread."""
        if scope.get("path") in self._direct:
            await self._app(scope, receive, send)
            return
        server = asyncio.get_running_loop()

        async def receive_on_server() -> Message:
            return await run_on(server, receive())

        async def send_on_server(message: Message) -> None:
            await run_on(server, send(message))

        await self._thread.run(self._app(scope, receive_on_server, send_on_server))


#: Addresses for documentation (RFC 5737, RFC 3849): the route to them leaves this machine.
_DOCUMENTATION_ADDRESSES = {socket.AF_INET: "198.51.100.1", socket.AF_INET6: "2001:db8::1"}


def external_url(host: str, port: int) -> str:
    """Return the address that others can open, of a server that listens at a host.

    One that listens everywhere (``0.0.0.0``, ``::``) is found at the address of the network that
    this machine would send by; without any network, on this machine.

    Examples
    --------
    >>> external_url("robot.local", 8080)
    'http://robot.local:8080/'
    >>> external_url("::1", 8080)
    'http://[::1]:8080/'
    """
    try:
        is_wildcard = ip_address(host).is_unspecified
    except ValueError:
        is_wildcard = False
    if is_wildcard:
        host = _outgoing_address(socket.AF_INET6 if ":" in host else socket.AF_INET)
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/"


def _outgoing_address(family: socket.AddressFamily) -> str:
    # Connecting a datagram socket sends nothing: it looks up the route.
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((_DOCUMENTATION_ADDRESSES[family], 9))
        except OSError:
            return "::1" if family is socket.AF_INET6 else "127.0.0.1"
        return str(probe.getsockname()[0])
