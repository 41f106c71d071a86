"""Run a job over all parts of an archive, here or on a Dask cluster; what is done stays done.

Every part is its own task: it reads one file and writes one, whole or not at all. So results are
the same wherever and in whatever order tasks run, and a second run goes on where the first ended.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet
from threadpoolctl import threadpool_limits

from palpate.errors import PalpateError
from palpate_archive.jobs import Job, digest
from palpate_archive.layout import Archive, Part, write_tables

#: Tries of a task whose worker died, without a cluster.
TRIES = 3
_JOB = b"palpate.job"
#: A scheduler that does not answer within this time is lost.
_PATIENCE_S = 10

Show = Callable[[float], None]


class ClusterError(PalpateError):
    """Workers or their scheduler were lost; what is done is kept."""

    exit_status = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One part, and where its results go."""

    job: Job
    source: Path
    target: Path
    #: Marks the results as those of this job and this part.
    mark: str

    @property
    def done(self) -> bool:
        """Whether the results are there."""
        try:
            marks = pa.parquet.read_schema(self.target).metadata or {}
        except (OSError, ValueError):
            return False
        return bool(marks.get(_JOB) == self.mark.encode())


def tasks_of(job: Job, archive: Archive, *, to: Path) -> list[Task]:
    """Return a task for each part that the job reads."""
    return [_task(job, archive, part, to=to) for part in archive.parts(job.reads)]


def _task(job: Job, archive: Archive, part: Part, *, to: Path) -> Task:
    source = archive.path(part)
    place = Path(job.name, *part.place.parts[1:])
    mark = json.dumps({"job": digest(job), "part": str(part.place), "bytes": source.stat().st_size})
    return Task(job=job, source=source.resolve(), target=(to / place).resolve(), mark=mark)


def forget_others(results: Path, tasks: Sequence[Task]) -> None:
    """Delete results of parts that are no longer there: compacting gave them other names."""
    kept = {task.target for task in tasks}
    for path in results.resolve().rglob("[!.]*.parquet"):
        if path not in kept and _JOB in (pa.parquet.read_schema(path).metadata or {}):
            path.unlink()


def perform(task: Task) -> int:
    """Do one task on one thread; return the rows written."""
    # Sums on more threads are taken in another order: their last bits would differ by machine.
    with threadpool_limits(limits=1):
        return write_tables(task.target, task.job.tables(task.source), marks={_JOB: task.mark})


def run_here(tasks: Sequence[Task], *, show: Show, workers: int | None = None) -> int:
    """Do tasks on the cores of this machine, a part on each at a time; return the rows written."""
    left, rows = list(tasks), 0
    for _ in range(TRIES):
        left, fresh = _round(left, workers=workers or os.cpu_count() or 1, show=show, of=len(tasks))
        rows += fresh
        if not left:
            return rows
    raise _deadly(left[0].source, f"{TRIES} times")


def _round(tasks: Sequence[Task], *, workers: int, show: Show, of: int) -> tuple[list[Task], int]:
    """Do what can be done until a worker dies; return what is left, and the rows written."""
    rows, left = 0, dict[Future[int], Task]()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        try:
            left = {pool.submit(perform, task): task for task in tasks}
            for future in as_completed(tuple(left)):
                rows += future.result()
                del left[future]
                show(of - len(left))
        except BrokenProcessPool:
            return list(left.values()), rows
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [], rows


def run_on_dask(tasks: Sequence[Task], *, scheduler: str | None, show: Show) -> int:
    """Do tasks on a Dask cluster whose workers see the same folders; return the rows written.

    `scheduler`: its address; None starts workers on this machine.
    Raises `ClusterError` if the scheduler is not there, or is lost on the way, or the workers of a
    task died as often as the cluster allows (`distributed.scheduler.allowed-failures`, 3 by
    default).
    """
    # A second's import, which work on this machine does without.
    from distributed import Client, KilledWorker
    from distributed.comm.core import CommClosedError

    rows = 0
    try:
        with _client(Client, scheduler) as client:
            futures = client.map(perform, tasks, pure=False)
            sources = {future.key: task.source for future, task in zip(futures, tasks, strict=True)}
            for number, result in enumerate(_results(client, futures), start=1):
                rows += result
                show(number)
    except KilledWorker as error:
        raise _deadly(sources[error.task], "each time") from error
    except (OSError, TimeoutError, CommClosedError) as error:
        raise _lost(scheduler) from error
    return rows


def _client(client: Any, scheduler: str | None) -> Any:
    if scheduler is None:
        return client(dashboard_address=None, set_as_default=False)
    return client(scheduler, timeout=_PATIENCE_S, set_as_default=False)


def _results(client: Any, futures: Sequence[Any]) -> Iterator[int]:
    import distributed
    from distributed.client import FutureCancelledError

    as_ended: Any = distributed.as_completed
    try:
        for future in as_ended(futures, loop=client.loop):
            yield int(future.result())
    except FutureCancelledError as error:
        raise OSError("the scheduler forgot the tasks") from error


def _lost(scheduler: str | None) -> ClusterError:
    return ClusterError(
        f"the Dask scheduler {scheduler or 'on this machine'} does not answer; what is done is "
        "kept: start it and run this again"
    )


def _deadly(source: Path, how_often: str) -> ClusterError:
    return ClusterError(
        f"{source}: the process that worked on it died {how_often}; is there memory enough? What "
        "is done is kept: run it again"
    )
