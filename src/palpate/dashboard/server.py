"""The server: the pages, the polled document, and the address of STOP."""

from __future__ import annotations

import asyncio
import gc
import os
import socket
import tempfile
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from palpate.dashboard.app_state import AppState, Settings
from palpate.dashboard.folder import find_recording
from palpate.dashboard.page_document import document
from palpate.dashboard.transport import LoopThread
from palpate.errors import DeviceError, InputError, require_extra
from palpate.line.machine import Line, Machine

if TYPE_CHECKING:
    from fastapi import FastAPI

    from palpate.mqtt.publisher import Publisher

#: Opens one protocol on this server.
LineOpener: TypeAlias = Callable[[Machine], Awaitable[Line]]

_STATIC = Path(__file__).parent / "static"
#: Controllers of a line see a change after this time at most, seconds.
_LINE_REFRESH_S = 0.05
#: What changes faster than this is not published, seconds.
_PUBLISH_PERIOD_S = 0.1
#: A driver whose connection breaks remains the driver for this time.
_RECONNECT_TIMEOUT_S = 10.0


def serve(
    settings: Settings,
    *,
    host: str,
    port: int,
    token: str | None,
    announce: Callable[[str], None],
    publisher: Publisher | None = None,
    lines: Sequence[LineOpener] = (),
) -> None:
    """Serve the dashboard until Ctrl-C; then stop the running job and the hand.

    `announce` gets the address once it can be visited, without the token; `publisher` gets every
    result and the state; `lines` serve controllers.

    Raises
    ------
    InputError
        If others could reach it without a token, or the devices may not come first.
    DeviceError
        If the port is taken.
    MissingExtraError
        If NiceGUI is not installed.
    """
    # NiceGUI wants a folder for what this page does not store.
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(Path(tempfile.gettempdir(), "palpate-page")))
    with require_extra("the dashboard", extra="dashboard"):
        import uvicorn
        from fastapi import FastAPI
        from nicegui import ui

        from palpate.dashboard.access import STOP_PATHS, AccessControl, check_token, is_loopback
        from palpate.dashboard.api import build_api
        from palpate.dashboard.transport import AppThread, BoundedConnection, external_url
    check_token(host, token)
    listening = _bind_port(host, port)
    app_state = AppState(settings)
    app = FastAPI(openapi_url=None)
    app.mount("/api", build_api(app_state, token=token is not None))
    _add_stop_route(app, app_state)
    _add_routes(app_state)
    app.router.on_startup.append(app_state.open)
    app.router.on_shutdown.append(app_state.close)
    if publisher is not None:
        _add_publisher(app, app_state, publisher)
    line_thread = LoopThread("lines") if lines else None
    if line_thread is not None:
        _serve_lines(app, app_state, lines, thread=line_thread)
    ui.run_with(
        app,
        title="palpate",
        language="en-US",
        favicon="🤏",
        dark=None,
        binding_refresh_interval=None,
        reconnect_timeout=_RECONNECT_TIMEOUT_S,
        message_history_length=100,
        tailwind=False,
        gzip_middleware_factory=None,
        show_welcome_message=False,
    )
    threaded = AppThread(app, direct=STOP_PATHS)
    gate = AccessControl(threaded, token=token, loopback=is_loopback(host))
    config = uvicorn.Config(
        gate,
        http=BoundedConnection,
        # The visitor is the connected address, never one from a header.
        proxy_headers=False,
        log_level="warning",
        access_log=False,
        timeout_graceful_shutdown=2,
    )
    address = external_url(host, listening.getsockname()[1])
    app.router.on_startup.append(lambda: announce(address))
    # A full collection of all that was imported would hold up every thread for 0.1 s.
    gc.freeze()
    with listening, threaded, line_thread or nullcontext():
        uvicorn.Server(config).run(sockets=[listening])


def _add_stop_route(app: FastAPI, app_state: AppState) -> None:
    """Add where the page stops; before the pages, whose framework has no part in it."""
    from fastapi.responses import JSONResponse

    @app.post("/stop")
    async def stop() -> JSONResponse:
        """Answer once the stop reached the hand; the page raises an alarm without an answer."""
        stopped = await app_state.stop()
        return JSONResponse({"stopped": stopped}, status_code=200 if stopped else 504)


def _add_routes(app_state: AppState) -> None:
    """Add the pages and the documents that they poll."""
    from fastapi.responses import FileResponse, JSONResponse, Response, StreamingResponse
    from nicegui import Client, app, ui

    from palpate.dashboard.page import TABS, build_operator_page, build_page
    from palpate.dashboard.transport import FilesGzip

    app.add_middleware(FilesGzip)
    # Requested each time: a page must not outlive an update.
    app.add_static_files("/static", _STATIC, max_cache_age=0)

    for name, path in TABS.items():
        ui.page(path)(lambda client, tab=name: build_page(app_state, client, tab=tab))

    @ui.page("/items/{item_id:path}")
    def item(client: Client, item_id: str) -> Response | None:
        if not item_id.strip():
            return Response("no item without a name", status_code=404, media_type="text/plain")
        build_page(app_state, client, tab="Items", item_id=item_id)
        return None

    @ui.page("/recordings/{name}")
    def one_recording(client: Client, name: str) -> None:
        build_page(app_state, client, tab="Recordings", recording=name)

    @ui.page("/operate")
    def operate(client: Client) -> None:
        build_operator_page(app_state, client)

    @app.get("/live")
    async def live(generation: int = -1, after_s: float = 0.0) -> JSONResponse:
        found: dict[str, Any] = document(
            app_state.session,
            generation=generation,
            after_s=after_s,
        )
        is_idle = found["verdict"]["kind"] == "idle"
        found["idle"] = app_state.idle_texts() if is_idle else []
        return JSONResponse(found | {"server_s": time.monotonic()})

    @app.get("/grasps.csv")
    def grasps() -> Response:
        named = {"Content-Disposition": 'attachment; filename="grasps.csv"'}
        parts = app_state.history.csv_parts()
        return StreamingResponse(parts, media_type="text/csv", headers=named)

    @app.get("/recordings/file/{name}")
    def recording(name: str) -> Response:
        try:
            file = find_recording(app_state.settings.folder, name)
        except InputError as error:
            return Response(str(error), status_code=404, media_type="text/plain")
        return FileResponse(file, filename=file.name)


def _add_publisher(app: Any, app_state: AppState, publisher: Publisher) -> None:
    """Publish every result and the state while the application runs."""
    app_state.on_result.append(publisher.publish_result)
    running: list[asyncio.Task[None]] = []

    async def publish() -> None:
        while True:
            publisher.publish_state(app_state.state())
            await asyncio.sleep(_PUBLISH_PERIOD_S)

    async def start() -> None:
        running.append(asyncio.create_task(publish()))

    # After the hand was stopped.
    async def end() -> None:
        for task in running:
            task.cancel()
        publisher.close()

    app.router.on_startup.append(start)
    app.router.on_shutdown.append(end)


def _serve_lines(
    app: Any, machine: Machine, lines: Sequence[LineOpener], *, thread: LoopThread
) -> None:
    """Serve the machine's line protocols together with the application.

    In a thread of their own: a controller that is not answered for a second drops the connection,
    and a page can take longer to build on a busy machine.
    """
    open_lines: list[Line] = []
    running: list[asyncio.Task[None]] = []

    async def refresh() -> None:
        while True:
            for line in open_lines:
                await line.refresh()
            await asyncio.sleep(_LINE_REFRESH_S)

    async def start() -> None:
        open_lines.extend([await opener(machine) for opener in lines])
        running.append(asyncio.create_task(refresh()))

    async def end() -> None:
        for task in running:
            task.cancel()
        for line in open_lines:
            await line.close()

    async def start_on_thread() -> None:
        await thread.run(start())

    async def end_on_thread() -> None:
        await thread.run(end())

    app.router.on_startup.append(start_on_thread)
    app.router.on_shutdown.append(end_on_thread)


def _bind_port(host: str, port: int) -> socket.socket:
    """Bind the port before a device is opened.

    Raises
    ------
    DeviceError
        If it can't be had.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise DeviceError(
            f"{host}:{port}: {error.strerror}; is palpate serve running already? "
            "Give another --port"
        ) from error
    return listening
