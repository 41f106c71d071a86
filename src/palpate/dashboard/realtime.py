"""Putting one process before all others, so that nothing on the machine holds up its loop."""

from __future__ import annotations

import os

from palpate.errors import InputError


def put_first(pid: int) -> None:
    """Schedule a process, and all threads that it will start, before those that are not so.

    Raises
    ------
    InputError
        If this system can't, or this user may not.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise InputError("--realtime needs Linux; leave it out")
    try:
        os.sched_setscheduler(pid, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        raise InputError(
            "--realtime: this user may not put a process before others; raise the limit `rtprio` "
            "(ulimit -r) to at least 1, or leave it out"
        ) from None


def check_realtime() -> None:
    """Find out whether a process may be put first, before anything is opened.

    Raises
    ------
    InputError
        As `put_first` does.
    """
    put_first(0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
