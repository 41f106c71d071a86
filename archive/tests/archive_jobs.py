"""Jobs that lose their worker, or its scheduler: what a power cut does, at a known moment."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.linalg  # noqa: F401 - its library is what has threads
import pyarrow as pa
import pyarrow.parquet
from threadpoolctl import threadpool_info


@dataclass(frozen=True, slots=True, kw_only=True)
class Killing:
    """Copies the times of holds; at the first part it kills a process, so often."""

    folder: Path
    times: int
    #: Process to kill; the worker itself where there is none.
    pid: int | None = None

    @property
    def name(self) -> str:
        return "killing"

    @property
    def reads(self) -> str:
        return "holds"

    @property
    def settings(self) -> str:
        return "always the same"

    def tables(self, path: Path) -> Iterator[Any]:
        killed = len(list(self.folder.glob("killed-*")))
        if killed < self.times:
            (self.folder / f"killed-{killed}").touch()
            os.kill(self.pid or os.getpid(), signal.SIGKILL)
        yield pa.parquet.read_table(path, columns=["time_s"], partitioning=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Threads:
    """Tells on how many threads linear algebra runs."""

    @property
    def name(self) -> str:
        return "threads"

    @property
    def reads(self) -> str:
        return "holds"

    @property
    def settings(self) -> str:
        return ""

    def tables(self, path: Path) -> Iterator[Any]:
        found = [pool["num_threads"] for pool in threadpool_info()]
        yield pa.table({"threads": found})
