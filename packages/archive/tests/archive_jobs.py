"""Jobs for the tests of the archive, importable by worker processes."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet

from palpate_archive.jobs import Job

#: Set by a test to let waiting tasks continue.
GO_ON = threading.Event()
STARTED = threading.Event()


def killing_job(folder: Path, *, always: bool = False) -> Job:
    """Return a job that copies times, and kills its process at the first part or at each one."""
    tables = partial(_copy_or_die, killed=folder / "killed", always=always)
    return Job(name="killing", reads="holds", settings={}, tables=tables)


def waiting_job() -> Job:
    """Return a job that copies times after `GO_ON` is set."""
    return Job(name="waiting", reads="holds", settings={}, tables=_copy_later)


def copying_job() -> Job:
    """Return a job that copies times."""
    return Job(name="copying", reads="holds", settings={}, tables=_copy)


def _copy(path: Path) -> Iterator[Any]:
    yield pyarrow.parquet.read_table(path, columns=["time_s"], partitioning=None)


def _copy_or_die(path: Path, *, killed: Path, always: bool) -> Iterator[Any]:
    if always or not killed.exists():
        killed.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    yield from _copy(path)


def _copy_later(path: Path) -> Iterator[Any]:
    STARTED.set()
    GO_ON.wait(30)
    yield from _copy(path)
