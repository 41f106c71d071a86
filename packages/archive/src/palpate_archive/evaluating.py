"""Evaluate a whole archive, with one atomically written file of results per file.

The name of a file of results is determined by its input, the settings and the code, so a second run
computes only what is missing, and the results do not depend on the order or the number of workers.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from threadpoolctl import threadpool_limits

import palpate
import palpate_archive
from palpate.errors import PalpateError
from palpate_archive.catalogue import Catalogue, Entry
from palpate_archive.folders import Folder
from palpate_archive.jobs import Job
from palpate_archive.layout import describe_file, write_tables

#: Name of the description of a result in the metadata of its Parquet file.
MARK = "palpate.result"


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One file and the file of its results."""

    job: Job
    archive: Folder
    source: Entry
    results: Folder
    target: str
    #: Versions of the code, which a worker compares with its own.
    code: dict[str, str]

    def perform(self) -> Entry:
        """Write the results if they do not exist; return their entry.

        Raises `PalpateError` if this process has other code than the one that planned the task.
        """
        if (mine := code_versions()) != self.code:
            raise PalpateError(
                f"a worker has other code ({list_versions(mine)}) than this computer "
                f"({list_versions(self.code)}); install the same versions on both"
            )
        if self.results.fs.exists(self.target):
            with self.results.fetch(self.target) as path:
                return describe_file(path, self.target)
        mark = {
            "job": self.job.name,
            "settings": self.job.settings,
            "code": self.code,
            "inputs": [{"file": self.source.file, "sha256": self.source.sha256}],
        }
        _keep_freed_memory()
        # More threads would change the order of sums, and so the last bits between machines.
        with threadpool_limits(limits=1), self.archive.fetch(self.source.file) as path:
            return write_tables(
                self.results,
                self.target,
                self.job.tables(path),
                sources=self.source.sources,
                marks={MARK: json.dumps(mark)},
            )


@cache
def _keep_freed_memory() -> None:
    """Let the C library reuse the memory of large arrays in this process.

    Dask starts workers with `MALLOC_TRIM_THRESHOLD_`, with which glibc maps each array of more than
    128 KB into memory again. That costs `settle` a third of its time. The values are those that
    glibc reaches by itself without the variable (mallopt(3)).
    """
    trim_threshold, mmap_threshold = -1, -3
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", lambda *_: 0)
        mallopt(mmap_threshold, 32 * 2**20)
        mallopt(trim_threshold, 64 * 2**20)


@cache
def code_versions() -> dict[str, str]:
    """Return the versions that determine results; that of palpate has a digest of its files."""
    found = hashlib.sha256()
    for package in (palpate, palpate_archive):
        root = Path(str(package.__file__)).parent
        for path in sorted(root.rglob("*.*")):
            # Compiled files, and firmware images that are built where a compiler is.
            if path.suffix not in {".pyc", ".hex"}:
                found.update(str(path.relative_to(root)).encode() + path.read_bytes())
    own = f"{version('palpate')}+{found.hexdigest()[:8]}"
    return {"palpate": own} | {name: version(name) for name in ("numpy", "scipy", "pyarrow")}


def list_versions(code: dict[str, str]) -> str:
    """Return the names and versions as a text."""
    return ", ".join(f"{name} {number}" for name, number in code.items())


def plan_tasks(job: Job, archive: Folder, *, to: Folder) -> list[Task]:
    """Return a task for each file of the job's kind."""
    code = code_versions()
    tasks = []
    for source in Catalogue(archive, job.reads).files():
        identity = json.dumps([job.name, job.settings, code, source.sha256])
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
        part = source.part._replace(kind=job.name, name=f"{source.part.name}-{digest}")
        task = Task(
            job=job, archive=archive, source=source, results=to, target=part.place, code=code
        )
        tasks.append(task)
    return tasks


def enter_results(catalogue: Catalogue, entries: Iterable[Entry], *, of: Catalogue) -> None:
    """Let the catalogue list these results alone; the others are deleted an hour later.

    `of`: catalogue of the input. Results of sources that were deleted since are deleted.
    """
    given = sorted(entries)
    while True:
        left = of.sources(deleted=False)
        kept = [entry for entry in given if left.issuperset(entry.sources)]
        catalogue.folder.delete(entry.file for entry in given if entry not in kept)
        for station in {*catalogue.stations(), *(entry.part.station for entry in kept)}:
            listed = [entry for entry in kept if entry.part.station == station]
            catalogue.change(station, lambda _, listed=listed: listed)  # type: ignore[misc]
            catalogue.expire(station)
        # Again if sources were deleted while the results were entered.
        if left <= of.sources(deleted=False):
            return
