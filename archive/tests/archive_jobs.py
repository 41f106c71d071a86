"""Jobs for the tests of the archive, importable by worker processes."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy.linalg  # noqa: F401 - loads the threaded library
import pyarrow as pa
import pyarrow.parquet

from palpate_archive.evaluating import Job


def killing_job(folder: Path) -> Job:
    """Return a job that copies times and kills its process at the first part."""
    tables = partial(_copy_or_die, killed=folder / "killed")
    return Job(name="killing", reads="holds", settings="", tables=tables)


def _copy_or_die(path: Path, *, killed: Path) -> Iterator[Any]:
    if not killed.exists():
        killed.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    yield pa.parquet.read_table(path, columns=["time_s"], partitioning=None)
