"""Perform tasks on the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from distributed import Client, LocalCluster, as_completed
from distributed.scheduler import KilledWorker

from palpate.errors import InputError, PalpateError
from palpate_archive.catalogue import Entry
from palpate_archive.evaluating import Task

#: Waiting for a scheduler or its first worker; longer after a restart.
_FIRST_WAIT_S, _RESTART_WAIT_S = 30.0, 300.0


def perform(
    tasks: Sequence[Task],
    *,
    show: Callable[[float], None],
    scheduler: str | None = None,
    workers: int | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> list[Entry]:
    """Perform tasks; return the entries of their results in the order of tasks.

    `scheduler`: address of a running Dask scheduler; by default a cluster on this computer with
    `workers` processes, one per core. `show` receives the number of finished tasks, `report` lines
    about the cluster. A task whose worker dies is repeated on another worker. After a restart of
    the scheduler, the tasks without results are sent again.
    Raises `PalpateError` if a task kills its workers again and again, for example without enough
    memory, or if the scheduler or its workers stay away.
    """
    found: dict[str, Entry] = {}
    workers = min(workers or os.cpu_count() or 1, len(tasks))
    with _silence_engine(), _open_cluster(scheduler, workers) as cluster:
        wait_s = _FIRST_WAIT_S
        while left := [task for task in tasks if task.target not in found]:
            with _connect(cluster, wait_s=wait_s) as client:
                report(f"dashboard: {client.dashboard_link}")
                for target, entry in _compute(client, left):
                    found[target] = entry
                    show(len(found))
            wait_s = _RESTART_WAIT_S
            if len(found) < len(tasks):
                report("lost the scheduler; waiting until it and its workers are back")
    return [found[task.target] for task in tasks]


def _compute(client: Client, tasks: Sequence[Task]) -> Iterator[tuple[str, Entry]]:
    """Yield targets and entries of finished tasks; end early if the scheduler is lost."""
    # Keys that name the results: two runs at the same time share their tasks.
    futures = client.map(Task.perform, tasks, key=[task.target for task in tasks])
    for future in as_completed(futures):
        if future.cancelled():
            return
        try:
            yield future.key, future.result()
        except KilledWorker as fault:
            raise PalpateError(
                f"{future.key}: several workers died at it, possibly from a lack of memory; run "
                "it again with more memory a worker to continue with the remaining files"
            ) from fault


@contextmanager
def _open_cluster(scheduler: str | None, workers: int) -> Iterator[Any]:
    """Yield what a client connects to."""
    if scheduler is not None:
        yield scheduler
        return
    cluster = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        # Any free port, so that several runs do not warn about each other.
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    )
    try:
        yield cluster
    finally:
        # On a busy computer workers may need longer to end; they end with this process.
        with suppress(TimeoutError):
            cluster.close()


@contextmanager
def _connect(cluster: Any, *, wait_s: float) -> Iterator[Client]:
    """Yield a client of a cluster with at least one worker."""
    try:
        client = Client(cluster, timeout=wait_s)
    except ValueError as fault:
        raise InputError(f"--scheduler {cluster}: {fault}; such as tcp://localhost:8786") from fault
    except OSError as fault:
        raise PalpateError(
            f"no scheduler at {cluster} in {wait_s:g} s; start one with `dask scheduler` and run "
            "this again to continue with the remaining files"
        ) from fault
    with client:
        try:
            client.wait_for_workers(1, timeout=wait_s)
        except TimeoutError as fault:
            raise PalpateError(
                f"the scheduler at {cluster} has no workers; start some with "
                f"`dask worker {cluster} --nthreads 1`"
            ) from fault
        yield client


@contextmanager
def _silence_engine() -> Iterator[None]:
    """Keep the engine's log of lost connections off the terminal; what matters is raised."""
    disabled = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(disabled)
