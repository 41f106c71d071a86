"""Signals that ask a program to stop: Ctrl-C, SIGTERM, and SIGHUP after a closed terminal."""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeAlias

Handler: TypeAlias = Callable[[int, FrameType | None], object]

#: A signal within this time after another belongs to the same request, seconds (guess). A terminal
#: and its shell both send SIGHUP, and users press Ctrl-C repeatedly.
REPEAT_S = 1.0

#: Period at which an interrupt tries again while a module is imported, seconds.
_IMPORT_WAIT_S = 0.02

#: SIGHUP, which Windows does not have.
HANGUP: tuple[int, ...] = tuple(filter(None, [getattr(signal, "SIGHUP", None)]))
ALL: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM, *HANGUP)

#: Time until which signals are repetitions of an earlier one.
_repeat_until_s = -math.inf
#: Number of running `finish_first` blocks, and whether an interrupt waits for their end.
_blocks = 0
_is_waiting = False


def handle_always(request: Callable[[], None]) -> Handler:
    """Return a handler that calls `request` at each signal."""

    def handle(number: int, frame: FrameType | None) -> None:
        _is_repeated()
        request()

    return handle


def handle_once(request: Callable[[], None]) -> Handler:
    """Return a handler that calls `request` at the first signal.

    Repetitions are ignored (`REPEAT_S`). A signal after a pause means that the request had no
    effect, and raises `KeyboardInterrupt`.
    """
    is_requested = False

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal is_requested
        if not is_requested:
            _is_repeated()
            is_requested = True
            request()
        else:
            interrupt(number, frame)

    return handle


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, unless the signal is a repetition (a handler)."""
    global _is_waiting, _repeat_until_s
    if _is_repeated():
        return
    if _blocks:
        _is_waiting = True
    elif _is_importing(frame):
        _repeat_until_s = -math.inf
        threading.Timer(_IMPORT_WAIT_S, _send_again, (number,)).start()
    else:
        raise KeyboardInterrupt


def _send_again(number: int) -> None:
    """Send a signal to the main thread, so that it also ends a wait there."""
    if sys.platform == "win32":
        signal.raise_signal(number)
    else:
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, number)


def _is_importing(frame: FrameType | None) -> bool:
    """Return whether a frame belongs to an import or to code that a library made.

    Interrupted there, compiled modules raise an `ImportError`, other libraries hide the interrupt,
    and made code (of `dataclasses`) ends the process by SIGINT although the interrupt is caught.
    """
    if frame is not None and frame.f_back is not None and frame.f_code.co_filename == "<string>":
        return True
    while frame is not None and frame.f_code.co_filename != "<frozen importlib._bootstrap>":
        frame = frame.f_back
    return frame is not None


def _is_repeated() -> bool:
    """Return whether a signal that arrives now is a repetition."""
    global _repeat_until_s
    now_s = time.monotonic()
    is_repeated = now_s < _repeat_until_s
    _repeat_until_s = now_s + REPEAT_S
    return is_repeated


@contextmanager
def finish_first() -> Iterator[None]:
    """Delay an interrupt by a handler of this module to the end of the block."""
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


@contextmanager
def watch_stop_signals(*, interrupts: bool = False) -> Iterator[Callable[[], bool]]:
    """Note the stop signals in the block; yield a function that returns whether one arrived.

    Unlike an interrupt, the note can't be lost in a library.

    `interrupts`: whether a signal also interrupts, which ends a wait.
    """
    received = threading.Event()

    def note_and_interrupt(number: int, frame: FrameType | None) -> None:
        received.set()
        interrupt(number, frame)

    with handle_stop_signals(note_and_interrupt if interrupts else handle_always(received.set)):
        yield received.is_set
