"""Perform tasks on the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import Any

import dask
from distributed import Client, as_completed
from distributed.scheduler import KilledWorker

from palpate.errors import InputError, PalpateError
from palpate_archive.catalogue import Entry
from palpate_archive.evaluating import Task

#: Waiting for a scheduler and its first worker; longer after a restart.
_FIRST_WAIT_S, _RESTART_WAIT_S = 30.0, 300.0
#: Of workers on this computer. Dask would stop a task 100 times a second to read its stack, and
#: wake each process 50 times a second to measure how late it is.
LOCAL_CONFIG = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
}


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
    the scheduler all tasks are sent again; those with results end at once.
    Raises `PalpateError` if a task kills its workers again and again, for example without enough
    memory, or if the scheduler or its workers stay away.
    """
    options: dict[str, Any] = {"address": scheduler}
    if scheduler is None:
        options = {
            "n_workers": min(workers or os.cpu_count() or 1, len(tasks)),
            "threads_per_worker": 1,
            # Any free port, so that several runs do not warn about each other.
            "dashboard_address": "127.0.0.1:0",
        }
    wait_s = _FIRST_WAIT_S
    while tasks:
        with _connect(options, wait_s=wait_s) as client:
            report(f"dashboard: {client.dashboard_link}")
            # Keys that name the results: two runs at the same time share their tasks.
            futures = client.map(Task.perform, tasks, key=[task.target for task in tasks])
            try:
                for number, future in enumerate(as_completed(futures), start=1):
                    if future.status != "finished":
                        future.result()
                    show(number)
                # All entries at once, without a request to a busy worker for each.
                return list(client.gather(futures))
            except CancelledError:
                report("lost the scheduler; waiting until it and its workers are back")
            except KilledWorker as fault:
                raise PalpateError(
                    f"{fault.task}: several workers died at it, possibly from a lack of memory; "
                    "run it again with more memory a worker to continue with the remaining files"
                ) from fault
        wait_s = _RESTART_WAIT_S
    return []


@contextmanager
def _connect(options: dict[str, Any], *, wait_s: float) -> Iterator[Client]:
    """Yield a client of a cluster with at least one worker."""
    address = options.get("address")
    # Dask logs lost connections; what matters is raised.
    disabled = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    client = None
    try:
        try:
            with dask.config.set(LOCAL_CONFIG):
                client = Client(timeout=wait_s, **options)
            client.wait_for_workers(1, timeout=wait_s)
        except ValueError as fault:
            raise InputError(
                f"--scheduler {address}: {fault}; such as tcp://localhost:8786"
            ) from fault
        except OSError as fault:
            raise PalpateError(
                f"no scheduler with workers at {address} in {wait_s:g} s; start both with "
                f"`dask scheduler` and `dask worker {address} --nthreads 1`, and run this again to "
                "continue with the remaining files"
            ) from fault
        yield client
    finally:
        # On a busy computer local workers may need longer to end; they end with this process.
        with suppress(TimeoutError):
            if client is not None:
                client.close()
        logging.disable(disabled)
