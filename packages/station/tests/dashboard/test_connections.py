"""HTTP connections: time limit of requests, and the maximum number of connections."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket
from websockets.asyncio.client import connect

from palpate_station.dashboard import front, listening
from palpate_station.dashboard import transport as connections
from palpate_station.dashboard.transport import BoundedConnection

STOP = b"POST /stop HTTP/1.1\r\nHost: robot\r\nContent-Length: 2\r\n\r\n{}"
#: Time limit of each operation, seconds.
TIMEOUT_S = 60.0


async def stop(request: Request) -> PlainTextResponse:
    return PlainTextResponse((await request.body()).decode())


async def large(request: Request) -> PlainTextResponse:
    return PlainTextResponse("x" * 50_000_000)


async def talk(web_socket: WebSocket) -> None:
    await web_socket.accept()
    async for text in web_socket.iter_text():
        await web_socket.send_text(text)


@asynccontextmanager
async def serving(**limits: int) -> AsyncIterator[int]:
    """Run a server on a free port, and yield the port."""
    routes = [Route("/stop", stop, methods=["POST"]), Route("/large", large)]
    app = Starlette(routes=[*routes, WebSocketRoute("/ws", talk)])
    config = uvicorn.Config(app, http=BoundedConnection, log_level="critical", lifespan="off")
    server = uvicorn.Server(config)
    with listening.bind_port("127.0.0.1", 0, **limits) as port:
        running = asyncio.create_task(server.serve(sockets=[port]))
        yield port.getsockname()[1]
        server.should_exit = True
        await running


def list_accepting() -> list[int]:
    """Return the numbers of this process's children that accept connections."""
    tasks = Path("/proc/self/task").glob("*/children")
    children = [number for task in tasks for number in task.read_text().split()]
    commands = {number: Path("/proc", number, "cmdline").read_bytes() for number in children}
    return [int(number) for number, line in commands.items() if front.__file__.encode() in line]


class Client:
    """A connection to the server."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    @classmethod
    async def open(cls, port: int, sent: bytes = b"") -> Client:
        client = cls(*await asyncio.open_connection("127.0.0.1", port))
        client._writer.write(sent)
        await client._writer.drain()
        return client

    async def send(self, sent: bytes) -> None:
        """Send bytes, in a packet of their own."""
        self._writer.write(sent)
        await self._writer.drain()
        await asyncio.sleep(0.05)

    async def ask(self, sent: bytes) -> bytes:
        """Send a request; return the status line, empty if the server closed the connection."""
        self._writer.write(sent)
        async with asyncio.timeout(TIMEOUT_S):
            status = await self._reader.readline()
            while (await self._reader.readline()).strip():
                pass
            await self._reader.readexactly(2 if status else 0)
        return status

    async def is_closed(self) -> bool:
        """Wait until the server closes the connection."""
        try:
            async with asyncio.timeout(TIMEOUT_S):
                return await self._reader.read(1) == b""
        except ConnectionError:
            return True

    async def close(self) -> None:
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()


@pytest.mark.slow
def test_bounded_connection_above_the_maximum_closes_the_oldest_and_accepts_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connections, "MAX_CONNECTIONS", 8)

    async def attack() -> None:
        async with serving() as port:
            page = await Client.open(port)
            assert await page.ask(STOP) == b"HTTP/1.1 200 OK\r\n"
            parts = (b"", b"POST", STOP[:-30], STOP[:-1])
            held = [await Client.open(port, part) for part in parts for _ in range(3)]
            fresh = await Client.open(port)
            assert await fresh.ask(STOP) == b"HTTP/1.1 200 OK\r\n"
            assert len(BoundedConnection._open) <= 8
            assert await held[0].is_closed()
            for client in (page, fresh, *held):
                await client.close()

    asyncio.run(attack())
    assert not BoundedConnection._open


def test_bounded_connection_above_the_rate_of_new_ones_serves_stops_only() -> None:
    async def flood() -> None:
        async with serving(max_new_connections=4) as port:
            held = [await Client.open(port, b"GET /") for _ in range(8)]
            head, body = STOP[:-2], STOP[-2:]
            fresh = await Client.open(port, head)
            assert await fresh.ask(body) == b"HTTP/1.1 200 OK\r\n"
            assert [await client.is_closed() for client in held[4:]] == [True] * 4
            assert await held[0].ask(b"x HTTP/1.1\r\n\r\n") == b"HTTP/1.1 404 Not Found\r\n"
            for client in (fresh, *held):
                await client.close()

    asyncio.run(flood())


@pytest.mark.slow
def test_listener_whose_accepting_process_was_killed_serves_the_connections_that_waited() -> None:
    async def kill() -> None:
        async with serving() as port:
            (accepting,) = list_accepting()
            os.kill(accepting, signal.SIGKILL)
            clients = [await Client.open(port) for _ in range(3)]
            for client in clients:
                assert await client.ask(STOP) == b"HTTP/1.1 200 OK\r\n"
                await client.close()
        assert not list_accepting()

    asyncio.run(kill())


@pytest.mark.slow
def test_bounded_connection_that_does_not_read_its_response_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connections, "RESPONSE_TIMEOUT_S", 0.1)

    async def leave() -> None:
        async with serving() as port:
            client = await Client.open(port, b"GET /large HTTP/1.1\r\nHost: h\r\n\r\n")
            async with asyncio.timeout(TIMEOUT_S):
                while not BoundedConnection._open:
                    await asyncio.sleep(0.01)
                while BoundedConnection._open:
                    await asyncio.sleep(0.01)
            await client.close()

    asyncio.run(leave())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "part"), [(b"", b""), (b"", STOP[:-1]), (STOP, b"POST"), (STOP, b"")]
)
def test_bounded_connection_with_an_incomplete_request_is_closed_after_the_time_limit(
    monkeypatch: pytest.MonkeyPatch, before: bytes, part: bytes
) -> None:
    monkeypatch.setattr(connections, "REQUEST_TIMEOUT_S", 0.1)
    # A connection that is idle after a complete request stays open.
    stays_open = before != b"" and part == b""

    async def hold() -> bool:
        async with serving() as port:
            client = await Client.open(port)
            if before:
                await client.ask(before)
            closed = asyncio.create_task(client.is_closed())
            client._writer.write(part)
            await asyncio.wait({closed}, timeout=0.5 if stays_open else TIMEOUT_S)
            found = closed.done()
            await client.close()
            return found and closed.result()

    assert asyncio.run(hold()) is not stays_open


@pytest.mark.slow
def test_websocket_stays_open_after_request_timeout_and_at_the_connection_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connections, "REQUEST_TIMEOUT_S", 0.05)
    monkeypatch.setattr(connections, "MAX_CONNECTIONS", 2)

    async def talk_late() -> str | bytes:
        async with serving() as port, connect(f"ws://127.0.0.1:{port}/ws") as web_socket:
            late = [await Client.open(port) for _ in range(4)]
            assert all([await client.is_closed() for client in late])
            for client in late:
                await client.close()
            await web_socket.send("here")
            return await web_socket.recv()

    assert asyncio.run(talk_late()) == "here"


def test_connection_limit_is_half_of_the_file_limit_and_at_most_1000(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for soft, most in ((1024, 512), (65_536, 1000), (-1, 1000)):
        monkeypatch.setattr(resource, "getrlimit", lambda which, soft=soft: (soft, soft))
        assert connections.connection_limit() == most
