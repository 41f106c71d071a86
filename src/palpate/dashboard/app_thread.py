"""The pages on an event loop of their own: STOP never waits for them."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable
from threading import Thread
from typing import TypeVar

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_T = TypeVar("_T")
#: Python lets another thread run this often, seconds. While a page was being built, an answer of a
#: direct path took 13.8 ms (p99 41) at the usual 5 ms, and 1.3 ms (p99 18) at this; the median of
#: 150, two loaded cores.
_SWITCH_S = 0.0005


class AppThread:
    """Runs an ASGI application on the event loop of a thread, except for some of its paths.

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
        self._runner = asyncio.Runner(loop_factory=asyncio.new_event_loop)
        self._loop, self._closed = self._runner.get_loop(), asyncio.Event()
        self._thread = Thread(target=self._runner.run, args=(self._closed.wait(),), name="pages")

    def __enter__(self) -> AppThread:
        self._usual_switch_s = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH_S)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        sys.setswitchinterval(self._usual_switch_s)
        self._loop.call_soon_threadsafe(self._closed.set)
        self._thread.join()
        self._runner.close()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a direct path here, and everything else in the thread."""
        if scope.get("path") in self._direct:
            await self._app(scope, receive, send)
            return
        server = asyncio.get_running_loop()

        async def receive_there() -> Message:
            return await _run_on(server, receive())

        async def send_there(message: Message) -> None:
            await _run_on(server, send(message))

        await _run_on(self._loop, self._app(scope, receive_there, send_there))


async def _run_on(loop: asyncio.AbstractEventLoop, work: Awaitable[_T]) -> _T:
    """Wait for what runs on the loop of another thread."""

    async def finish() -> _T:
        return await work

    return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(finish(), loop))
