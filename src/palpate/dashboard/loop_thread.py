"""An event loop on a thread of its own, and how to wait for what runs there."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from threading import Thread
from typing import TypeVar

_T = TypeVar("_T")


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
        """Wait for what runs on the loop, from another one."""
        return await run_on(self._loop, work)


async def run_on(loop: asyncio.AbstractEventLoop, work: Awaitable[_T]) -> _T:
    """Wait for what runs on the loop of another thread."""

    async def finish() -> _T:
        return await work

    return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(finish(), loop))
