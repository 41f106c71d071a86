"""Signals that ask a program to stop: Ctrl-C, SIGTERM, and SIGHUP after a closed terminal."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeAlias

Handler: TypeAlias = Callable[[int, FrameType | None], object]

#: Further signals within this time belong to the first, seconds (guess). A terminal and its shell
#: both send SIGHUP, and users press Ctrl-C repeatedly.
REPEAT_S = 2.0

#: SIGHUP, which Windows does not have.
HANGUP: tuple[int, ...] = tuple(filter(None, [getattr(signal, "SIGHUP", None)]))
ALL: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM, *HANGUP)

#: Number of running `finish_first` blocks, and whether an interrupt waits for their end.
_blocks = 0
_is_waiting = False


def handle_once(request: Callable[[], None]) -> Handler:
    """Return a handler that calls `request` at the first signal.

    Repetitions within `REPEAT_S` are ignored. A later signal means that the request had no effect
    and raises `KeyboardInterrupt`.
    """
    until_s = -math.inf
    is_requested = False

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal until_s, is_requested
        global _is_waiting
        now_s = time.monotonic()
        if now_s < until_s:
            return
        until_s = now_s + REPEAT_S
        if not is_requested:
            is_requested = True
            request()
        elif _blocks:
            _is_waiting = True
        else:
            raise KeyboardInterrupt

    return handle


def interrupt() -> None:
    """Raise `KeyboardInterrupt`."""
    raise KeyboardInterrupt


@contextmanager
def finish_first() -> Iterator[None]:
    """Delay an interrupt by a handler of `handle_once` to the end of the block."""
    global _blocks, _is_waiting
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _blocks += 1
    try:
        yield
    finally:
        _blocks -= 1
        if _is_waiting and not _blocks:
            _is_waiting = False
            raise KeyboardInterrupt


def install(
    handler: Handler | signal.Handlers, *, numbers: tuple[int, ...] = ALL
) -> dict[int, object]:
    """Install a handler of signals; return number -> handler before.

    SIGHUP stays ignored if it is already ignored (`nohup`). Outside of the main thread nothing is
    installed, because Python runs handlers in the main thread only.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {
        number: signal.signal(number, handler)
        for number in numbers
        if number not in HANGUP or signal.getsignal(number) is not signal.SIG_IGN
    }


@contextmanager
def handle_stop_signals(handler: Handler) -> Iterator[None]:
    """Handle the stop signals in the block, as `install` does."""
    before = install(handler)
    try:
        yield
    finally:
        for number, old in before.items():
            # None is a handler that was not installed from Python and can't be restored.
            signal.signal(number, signal.SIG_DFL if old is None else old)  # type: ignore[arg-type]
