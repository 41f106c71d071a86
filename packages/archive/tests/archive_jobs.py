"""Jobs for the tests of the archive, importable by worker processes."""

from __future__ import annotations

import os
import resource
import signal
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from palpate_archive.jobs import Job, create_settle_job

#: Set by a test to let waiting tasks continue.
GO_ON = threading.Event()
STARTED = threading.Event()


def killing_job(folder: Path, *, always: bool = False) -> Job:
    """Return a job that settles, and kills its process while it writes the first file or any."""
    settle = create_settle_job(method="relaxation", horizon_s=10.0).tables
    tables = partial(_settle_or_die, settle=settle, killed=folder / "killed", always=always)
    return Job(name="killing", reads="holds", settings={}, tables=tables)


def waiting_job() -> Job:
    """Return a job that copies times after `GO_ON` is set."""
    return Job(name="waiting", reads="holds", settings={}, tables=_copy_later)


def copying_job() -> Job:
    """Return a job that copies times."""
    return Job(name="copying", reads="holds", settings={}, tables=_copy)


def faulting_job() -> Job:
    """Return a job that counts the pages mapped for each of many large arrays."""
    return Job(name="faulting", reads="holds", settings={}, tables=_count_faults)


def _copy(path: Path) -> Iterator[Any]:
    yield pyarrow.parquet.read_table(path, columns=["time_s"], partitioning=None)


def _settle_or_die(
    path: Path, *, settle: Callable[[Path], Iterator[Any]], killed: Path, always: bool
) -> Iterator[Any]:
    yield from settle(path)
    if always or not killed.exists():
        killed.touch()
        os.kill(os.getpid(), signal.SIGKILL)


def _count_faults(_: Path) -> Iterator[Any]:
    arrays, counts = 50, list[int]()
    for _ in range(2):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(arrays):
            np.ones(2**18)
        counts.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    yield pa.table({"faults": [counts[-1] / arrays]})


def _copy_later(path: Path) -> Iterator[Any]:
    STARTED.set()
    GO_ON.wait(30)
    yield from _copy(path)
