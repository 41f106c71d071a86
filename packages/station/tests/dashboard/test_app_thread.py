"""Pages run on a separate event loop, the server's loop answers a stop, and its external URL."""

from __future__ import annotations

import asyncio
import socket
import threading
from typing import Any
from urllib.parse import urlsplit

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from palpate_station.dashboard import transport
from palpate_station.dashboard.transport import AppThread, external_url


async def ask(app: AppThread, path: str) -> list[dict[str, Any]]:
    """Send a request; return the messages of the response."""
    scope = {"type": "http", "method": "POST", "path": path, "headers": [], "query_string": b""}
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Any) -> None:
        sent.append(message)

    await app(scope, receive, send)
    return sent


async def stop(request: Request) -> PlainTextResponse:
    return PlainTextResponse("stopped")


def test_app_thread_answers_a_direct_path_while_a_page_blocks_its_event_loop() -> None:
    blocked, over = threading.Event(), threading.Event()

    async def page(request: Request) -> PlainTextResponse:
        blocked.set()
        assert over.wait(60.0)
        return PlainTextResponse("page")

    async def visit(app: AppThread) -> tuple[bytes, bytes]:
        viewer = asyncio.create_task(ask(app, "/page"))
        await asyncio.to_thread(blocked.wait)
        stopped = (await ask(app, "/stop"))[1]["body"]
        assert not viewer.done()
        over.set()
        return stopped, (await viewer)[1]["body"]

    routes = [Route("/page", page, methods=["POST"]), Route("/stop", stop, methods=["POST"])]
    with AppThread(Starlette(routes=routes), direct=frozenset({"/stop"})) as app:
        assert asyncio.run(visit(app)) == (b"stopped", b"page")


def test_app_thread_refuses_requests_above_its_limit_except_direct_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(transport, "MAX_REQUESTS", 2)
    done = threading.Event()

    async def page(request: Request) -> PlainTextResponse:
        await asyncio.to_thread(done.wait, 30.0)
        return PlainTextResponse("page")

    async def visit(app: AppThread) -> list[int]:
        waiting = [asyncio.create_task(ask(app, "/page")) for _ in range(2)]
        await asyncio.sleep(0.1)
        answers = [await ask(app, path) for path in ("/page", "/stop")]
        done.set()
        answers += [*await asyncio.gather(*waiting), await ask(app, "/page")]
        return [answer[0]["status"] for answer in answers]

    routes = [Route("/page", page, methods=["POST"]), Route("/stop", stop, methods=["POST"])]
    with AppThread(Starlette(routes=routes), direct=frozenset({"/stop"})) as app:
        assert asyncio.run(visit(app)) == [503, 200, 200, 200, 200]


def test_app_thread_raises_errors_of_the_application_on_the_server_loop() -> None:
    async def broken(scope: Any, receive: Any, send: Any) -> None:
        raise RuntimeError("broken page")

    with (
        AppThread(broken, direct=frozenset()) as app,
        pytest.raises(RuntimeError, match="broken page"),
    ):
        asyncio.run(ask(app, "/"))


@pytest.mark.parametrize(("host", "family"), [("0.0.0.0", socket.AF_INET), ("::", socket.AF_INET6)])
def test_external_url_of_a_wildcard_host_accepts_connections(
    host: str, family: socket.AddressFamily
) -> None:
    with socket.socket(family) as listening:
        listening.bind((host, 0))
        listening.listen()
        parts = urlsplit(external_url(host, listening.getsockname()[1]))
        assert parts.hostname not in ("0.0.0.0", "::", None)
        with socket.create_connection((parts.hostname, parts.port), timeout=10):
            pass
