"""HTTP connection limits, event-loop threads, and the external URL of the server."""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import Awaitable
from contextlib import suppress
from ipaddress import ip_address
from threading import Thread
from typing import ClassVar, TypeVar

from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

_T = TypeVar("_T")
#: Time limit for a complete request after its first byte or the start of its connection, seconds
#: (guess). A page on a slow network requires far less.
REQUEST_TIMEOUT_S = 5.0
#: Maximum number of connections, if the process may open twice as many files.
MAX_CONNECTIONS = 1000
#: Time after which a client that does not read its response is disconnected, seconds (guess).
RESPONSE_TIMEOUT_S = 10.0
#: Requests other than stops that are worked on at a time (guess). Without a limit a stop took up to
#: 3.9 s while 1100 clients requested pages and read nothing (two loaded cores); with this limit,
#: the time limit above and the limit of new connections 0.4 s (two cores).
MAX_REQUESTS = 64

#: Maximum size of a request's body, bytes. The page and the API send far less; the page's framework
#: accepts as much.
_MAX_BODY_BYTES = 1_000_000


class BoundedConnection(HttpToolsProtocol):
    """An HTTP connection with a time limit for each request and for reading each response.

    Otherwise, connections that send nothing or very little could exhaust the file descriptors and
    block all viewers. Above the connection limit, the connection with the longest silence is
    closed, so a STOP always gets a connection. WebSockets are not counted, because their clients
    are already authorized.
    """

    #: All connections, ordered by their last activity, oldest first.
    _open: ClassVar[dict[BoundedConnection, None]] = {}
    _timeout: asyncio.TimerHandle | None = None
    _read_timeout: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Add the connection; close the oldest ones above the limit."""
        super().connection_made(transport)
        self._start_timeout()
        while len(self._open) > connection_limit():
            next(iter(self._open)).drop()

    def data_received(self, data: bytes) -> None:
        """Process received bytes of a request."""
        self._start_timeout()
        super().data_received(data)

    def on_message_complete(self) -> None:
        """Cancel the time limit of the complete request."""
        self._cancel_timeout()
        super().on_message_complete()

    def pause_writing(self) -> None:
        """Wait for a client that does not read, for a limited time."""
        super().pause_writing()
        self._read_timeout = self.loop.call_later(RESPONSE_TIMEOUT_S, self.drop)

    def resume_writing(self) -> None:
        """Continue with a client that reads."""
        super().resume_writing()
        self._cancel_read_timeout()

    def handle_websocket_upgrade(self) -> None:
        """Stop counting the connection, which is now a WebSocket."""
        self._remove()
        super().handle_websocket_upgrade()

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection."""
        self._remove()
        super().connection_lost(exc)

    def drop(self) -> None:
        """Close the connection without a response."""
        self._remove()
        self.transport.abort()

    def _start_timeout(self) -> None:
        """Record activity, and start the time limit unless it is already running."""
        self._open.pop(self, None)
        self._open[self] = None
        if self._timeout is None:
            self._timeout = self.loop.call_later(REQUEST_TIMEOUT_S, self.drop)

    def _remove(self) -> None:
        self._cancel_timeout()
        self._cancel_read_timeout()
        self._open.pop(self, None)

    def _cancel_timeout(self) -> None:
        if self._timeout is not None:
            self._timeout.cancel()
            self._timeout = None

    def _cancel_read_timeout(self) -> None:
        if self._read_timeout is not None:
            self._read_timeout.cancel()
            self._read_timeout = None


def connection_limit() -> int:
    """Return the maximum number of connections: at most half of the limit on open files."""
    if sys.platform != "win32":
        with suppress(ImportError):
            import resource

            soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
            return MAX_CONNECTIONS if soft < 0 else min(MAX_CONNECTIONS, soft // 2)
    return MAX_CONNECTIONS


#: Python's thread switch interval, seconds. While a thread computes, each system call of the
#: server's loop waits this long. During the construction of a page, the median response time of a
#: direct path was 13.8 ms at the default of 5 ms and 1.3 ms at 0.5 ms (150 requests, two loaded
#: cores).
_THREAD_SWITCH_S = 0.0005


#: Paths of static files.
_STATIC_PATHS = ("/static/", "/_nicegui/")


class FilesGzip(GZipMiddleware):
    """Compresses static files, but neither polled documents nor downloads."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        is_file = scope["type"] == "http" and scope["path"].startswith(_STATIC_PATHS)
        await (super().__call__ if is_file else self.app)(scope, receive, send)


class LoopThread:
    """A context manager that runs an event loop on a separate thread."""

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
        """Run an awaitable on this loop and return its result to the caller's loop."""
        return await run_on(self._loop, work)


async def run_on(loop: asyncio.AbstractEventLoop, work: Awaitable[_T]) -> _T:
    """Run an awaitable on the event loop of another thread and return its result."""

    async def finish() -> _T:
        return await work

    return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(finish(), loop))


class AppThread:
    """Runs an ASGI application, except for direct paths, on a separate thread.

    The server's loop then only reads requests, checks access and answers the direct paths. A slow
    page or disk blocks only the loop of the thread. Requests above `MAX_REQUESTS` at a time are
    refused.

    Parameters
    ----------
    app : ASGI application
        The application.
    direct : frozenset of str
        Paths whose handlers run on the server's loop.
    """

    def __init__(self, app: ASGIApp, *, direct: frozenset[str]) -> None:
        self._app, self._direct, self._requests = app, direct, 0
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
        """Answer direct paths on this loop and all other requests on the thread."""
        if scope.get("path") in self._direct:
            await self._app(scope, receive, send)
            return
        server = asyncio.get_running_loop()
        first: Message | None = None
        if scope["type"] == "http":
            # A body that arrives byte by byte would otherwise wake both loops for each byte. With
            # a thousand of them, a STOP waited for seconds.
            first = await _read_request(receive)
            if first is None:
                await PlainTextResponse("the request is too large", 413)(scope, receive, send)
                return
            if first["type"] == "http.disconnect":
                return
            if self._requests >= MAX_REQUESTS:
                refusal = PlainTextResponse("too many requests at once: try again", 503)
                await refusal(scope, receive, send)
                return

        async def receive_on_server() -> Message:
            nonlocal first
            if first is not None:
                message, first = first, None
                return message
            return await run_on(server, receive())

        async def send_on_server(message: Message) -> None:
            await run_on(server, send(message))

        self._requests += scope["type"] == "http"
        try:
            await self._thread.run(self._app(scope, receive_on_server, send_on_server))
        finally:
            self._requests -= scope["type"] == "http"


async def _read_request(receive: Receive) -> Message | None:
    """Return a request with its body, or a disconnection; None if too large."""
    body = bytearray()
    while True:
        message = await receive()
        if message["type"] != "http.request":
            return message
        body += message.get("body", b"")
        if len(body) > _MAX_BODY_BYTES:
            return None
        if not message.get("more_body", False):
            return {"type": "http.request", "body": bytes(body), "more_body": False}


#: Addresses reserved for documentation (RFC 5737, RFC 3849), reached through the default route.
_DOCUMENTATION_ADDRESSES = {socket.AF_INET: "198.51.100.1", socket.AF_INET6: "2001:db8::1"}


def external_url(host: str, port: int) -> str:
    """Return a URL that reaches the server from other machines.

    For a wildcard host (``0.0.0.0``, ``::``) it uses the address of the interface with the default
    route, or the loopback address without a network.

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
    # Connecting a UDP socket sends nothing, but selects the route and thus the local address.
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((_DOCUMENTATION_ADDRESSES[family], 9))
        except OSError:
            return "::1" if family is socket.AF_INET6 else "127.0.0.1"
        return str(probe.getsockname()[0])
