"""The web server: pages, live-state endpoint polled by the pages, API and STOP route."""

from __future__ import annotations

import asyncio
import gc
import os
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from palpate.errors import DeviceError, InputError
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.audit import LOG, write_log
from palpate_station.dashboard.folder import find_recording
from palpate_station.dashboard.front import STOP_PATHS
from palpate_station.dashboard.listening import bind_port
from palpate_station.dashboard.lot import lot_text
from palpate_station.dashboard.monitor import Monitor
from palpate_station.dashboard.page_document import document
from palpate_station.dashboard.retention import delete_old_recordings
from palpate_station.dashboard.session import page_name
from palpate_station.dashboard.settings import Settings
from palpate_station.dashboard.transport import LoopThread
from palpate_station.line.machine import Line, Machine

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.requests import Request

    from palpate_station.dashboard.users import User
    from palpate_station.mqtt.publisher import Publisher

#: Starts a line protocol for this server.
LineOpener: TypeAlias = Callable[[Machine], Awaitable[Line]]

_STATIC = Path(__file__).parent / "static"
#: Longest wait for the end of each part of a start that failed, seconds.
_UNDO_S = 2.0
#: File in the folder that the running server locks.
_LOCK_FILE = ".serve.lock"
#: Period at which line protocols are refreshed, seconds.
_LINE_REFRESH_S = 0.05
#: Period at which the state is published, seconds.
_PUBLISH_PERIOD_S = 0.1
#: Period at which old recordings are deleted, seconds.
_RETENTION_PERIOD_S = 3600.0
#: Period at which the devices are examined for `--exit-after`, seconds.
_WATCHDOG_PERIOD_S = 0.5
#: A driver with a broken connection stays the driver for this time, seconds.
_RECONNECT_TIMEOUT_S = 10.0


def serve(
    settings: Settings,
    *,
    host: str,
    port: int,
    token: str | None,
    users: Sequence[User] = (),
    certificate: Path | None = None,
    key: Path | None = None,
    announce: Callable[[str], None],
    publisher: Publisher | None = None,
    lines: Sequence[LineOpener] = (),
) -> None:
    """Serve the dashboard until Ctrl-C; then stop the running job and the hand.

    `announce` is called with the URL (without the token) when the server is ready. `publisher`
    receives every result and the state. With a `certificate` and its `key` (PEM) the server speaks
    HTTPS. `lines` start the protocols for line controllers.

    Raises
    ------
    InputError
        If the token is too short, or if other machines could connect without a token.
    DeviceError
        If the port is in use, or the devices have not worked for `settings.exit_after_s`.
    MissingExtraError
        If NiceGUI is not installed.
    """
    # NiceGUI requires a storage folder, although this page stores nothing in it.
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(Path(tempfile.gettempdir(), "palpate-page")))
    import uvicorn
    from fastapi import FastAPI

    from palpate_station.dashboard.access import AccessControl, check_token, is_loopback
    from palpate_station.dashboard.api import build_api
    from palpate_station.dashboard.transport import AppThread, BoundedConnection, external_url

    check_token(host, token, users=users)
    listening = bind_port(host, port)
    app_state = AppState(settings)
    app = FastAPI(openapi_url=None)
    monitor = Monitor(app_state, publisher)
    api = build_api(app_state, monitor, token=token is not None or bool(users))
    # The path without a version is that of the newest one.
    app.mount("/api/v1", api)
    app.mount("/api", api)
    app.router.on_startup.append(app_state.open)
    app.router.on_shutdown.append(app_state.close)
    line_thread = LoopThread("lines") if lines else None
    if line_thread is not None:
        _serve_lines(app, app_state, lines, thread=line_thread)
    # Last, because a server that finds a port in use must not be online for a moment.
    if publisher is not None:
        _add_publisher(app, app_state, publisher)
    _add_stop_route(app, app_state)
    _add_metrics_route(app, monitor)
    _add_retention(app, app_state)
    _run_while_serving(app, app_state.watch_given_bins)
    _add_pages(app, app_state)
    threaded = AppThread(app, direct=STOP_PATHS)
    gate = AccessControl(threaded, token=token, users=users, loopback=is_loopback(host))
    config = uvicorn.Config(
        gate,
        http=BoundedConnection,
        # Others don't call the listener's `accept`.
        loop="asyncio",
        # The client address is the connected peer, never an address from a header.
        proxy_headers=False,
        log_level="warning",
        # Its lines are part of the station's log, with their time.
        log_config=None,
        access_log=False,
        timeout_graceful_shutdown=2,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    address = external_url(host, listening.getsockname()[1])
    if certificate is not None:
        address = address.replace("http:", "https:", 1)
    app.router.on_startup.append(lambda: announce(address))
    server, failures = uvicorn.Server(config), list[str]()

    def end_after_failure(text: str) -> None:
        failures.append(text)
        server.should_exit = True

    _end_after_failed_start(app, end_after_failure)
    if settings.exit_after_s is not None:
        _add_watchdog(app, monitor, limit_s=settings.exit_after_s, on_failure=end_after_failure)
    # A full collection of all imported objects would block every thread for 0.1 s.
    gc.freeze()
    with (
        listening,
        _lock_folder(settings.folder),
        write_log(settings.folder),
        threaded,
        line_thread or nullcontext(),
    ):
        server.run(sockets=[listening])
    if failures:
        raise DeviceError(failures[0])


@contextmanager
def _lock_folder(folder: Path) -> Iterator[None]:
    """Keep a folder from another server, which would mix up history, audit and recordings.

    The lock ends with this process, however it ends. Windows has none.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    with (folder / _LOCK_FILE).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DeviceError(
                f"--folder {folder}: another palpate serve uses it; give each its own folder"
            ) from error
        yield


def _end_after_failed_start(app: FastAPI, on_failure: Callable[[str], None]) -> None:
    """Undo a start that fails, and end with one line; the server would run on without pages."""
    starts, router = list(app.router.on_startup), app.router

    async def start() -> None:
        try:
            for one in starts:
                if (waiting := one()) is not None:
                    await waiting
        except Exception as error:
            for end in router.on_shutdown:
                # What did not start may not end either.
                with suppress(Exception):
                    async with asyncio.timeout(_UNDO_S):
                        if (waiting := end()) is not None:
                            await waiting
            on_failure(str(error) or repr(error))

    router.on_startup[:] = [start]


def _add_stop_route(app: FastAPI, app_state: AppState) -> None:
    """Add the STOP route to the outer application, independently of the page framework."""
    from fastapi.responses import JSONResponse

    async def stop(request: Request) -> JSONResponse:
        """Stop the hand; answer 200 after its confirmation, or 504 without one."""
        client = request.client
        user, host = request.scope.get("palpate_user"), "" if client is None else client.host
        stopped = await app_state.stop(page_name(host, user))
        return JSONResponse({"stopped": stopped}, status_code=200 if stopped else 504)

    app.add_route("/stop", stop, methods=["POST"])


def _add_metrics_route(app: FastAPI, monitor: Monitor) -> None:
    from fastapi.responses import PlainTextResponse

    def metrics(request: Request) -> PlainTextResponse:
        return PlainTextResponse(monitor.metrics(), media_type="text/plain; version=0.0.4")

    app.add_route("/metrics", metrics, methods=["GET"])


def _add_watchdog(
    app: FastAPI, monitor: Monitor, *, limit_s: float, on_failure: Callable[[str], None]
) -> None:
    """Call a function with one line after a time without working devices."""

    async def watch() -> None:
        failed_s: float | None = None
        while True:
            problems, now_s = monitor.device_problems(), time.monotonic()
            failed_s = (failed_s or now_s) if problems else None
            if failed_s is not None and now_s - failed_s > limit_s:
                text = f"{problems[0]} (for {limit_s:g} s, --exit-after)"
                LOG.error("%s", text)
                on_failure(text)
                return
            await asyncio.sleep(_WATCHDOG_PERIOD_S)

    _run_while_serving(app, watch)


def _add_retention(app: FastAPI, app_state: AppState) -> None:
    """Delete old recordings at the start and every hour."""
    keep_days, folder = app_state.settings.keep_days, app_state.settings.folder
    if keep_days is None:
        return

    async def delete_regularly() -> None:
        while True:
            in_use = app_state.session.devices.files_in_use
            work = partial(delete_old_recordings, folder, keep_days=keep_days, in_use=in_use)
            await asyncio.get_running_loop().run_in_executor(None, work)
            await asyncio.sleep(_RETENTION_PERIOD_S)

    _run_while_serving(app, delete_regularly)


def _run_while_serving(app: FastAPI, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a task from the start of the application to its end."""
    running: list[asyncio.Task[None]] = []

    async def start() -> None:
        running.append(asyncio.create_task(work()))

    async def end() -> None:
        for task in running:
            task.cancel()

    app.router.on_startup.append(start)
    app.router.on_shutdown.append(end)


def _add_pages(outer: FastAPI, app_state: AppState) -> None:
    """Add the pages, the live-state endpoint and the downloads to the outer application."""
    from nicegui import ui

    _add_page_routes(app_state)
    ui.run_with(
        outer,
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


def _add_page_routes(app_state: AppState) -> None:
    """Add the pages, the live-state endpoint and the downloads to NiceGUI's application."""
    from fastapi.responses import FileResponse, JSONResponse, Response, StreamingResponse
    from nicegui import Client, app, ui

    from palpate_station.dashboard.page import TABS, build_operator_page, build_page
    from palpate_station.dashboard.transport import FilesGzip

    app.add_middleware(FilesGzip)
    # No caching: after an update, browsers must load the new scripts.
    app.add_static_files("/static", _STATIC, max_cache_age=0)

    for name, path in TABS.items():
        ui.page(path)(lambda client, tab=name: build_page(app_state, client, tab=tab))

    @ui.page("/items/{item_id:path}")
    def item(client: Client, item_id: str) -> Response | None:
        if not item_id.strip():
            return Response("an item needs a name", status_code=404, media_type="text/plain")
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
        content = document(app_state.session, generation=generation, after_s=after_s)
        is_idle = content["verdict"]["kind"] == "idle"
        content["idle"] = app_state.idle_texts() if is_idle else []
        content["lot"] = lot_text(app_state.history.lot, app_state.session.words)
        return JSONResponse(content | {"server_s": time.monotonic()})

    @app.get("/grasps.csv")
    def grasps() -> Response:
        headers = {"Content-Disposition": 'attachment; filename="grasps.csv"'}
        parts = app_state.history.csv_parts()
        return StreamingResponse(parts, media_type="text/csv", headers=headers)

    @app.get("/recordings/file/{name}")
    def recording(name: str) -> Response:
        try:
            file = find_recording(app_state.settings.folder, name)
        except InputError as error:
            return Response(str(error), status_code=404, media_type="text/plain")
        return FileResponse(file, filename=file.name)


def _add_publisher(app: Any, app_state: AppState, publisher: Publisher) -> None:
    """Publish every result and the state over MQTT while the application runs."""
    app_state.on_result.append(publisher.publish_result)
    app.router.on_startup.append(publisher.start)

    async def publish() -> None:
        while True:
            publisher.publish_state(app_state.state())
            await asyncio.sleep(_PUBLISH_PERIOD_S)

    _run_while_serving(app, publish)
    # Runs after `AppState.close`, which has stopped the hand.
    app.router.on_shutdown.append(publisher.close)


def _serve_lines(
    app: Any, machine: Machine, lines: Sequence[LineOpener], *, thread: LoopThread
) -> None:
    """Serve the line protocols while the application runs, on a separate thread.

    A controller drops its connection after one second without an answer. Building a page on a busy
    machine can block the application's event loop for longer.
    """
    open_lines: list[Line] = []
    running: list[asyncio.Task[None]] = []

    async def refresh() -> None:
        while True:
            for line in open_lines:
                await line.refresh()
            await asyncio.sleep(_LINE_REFRESH_S)

    async def start() -> None:
        for opener in lines:
            line = await opener(machine)
            # Known at once, because the next one may fail.
            open_lines.append(line)
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
