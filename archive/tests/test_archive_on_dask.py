"""The archive on a Dask cluster: the same bytes, whoever dies; a lost scheduler is one line."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from archive.tests.archive_jobs import Killing

from palpate_archive.jobs import Settle
from palpate_archive.layout import Archive, Part
from palpate_archive.running import ClusterError, perform, run_on_dask, tasks_of

PARTS = 6


@pytest.fixture
def archive(tmp_path: Path) -> Archive:
    """Six files of holds that creep with the logarithm of time."""
    made, rng = Archive(tmp_path / "archive", create=True), np.random.default_rng(4)
    time_s = np.arange(0.0, 21.0, 0.1)
    for number in range(PARTS):
        columns = {
            "recording": [f"r{number}"] * time_s.size,
            "hold_id": [f"h{number}"] * time_s.size,
            "time_s": time_s,
            "value": 9000.0 - 300.0 * np.log(time_s + 0.3) + rng.normal(0.0, 2.0, time_s.size),
            "channel": ["mean"] * time_s.size,
            "unit": ["ohm"] * time_s.size,
        }
        part = Part(kind="holds", station="north", date="2026-05-01", name=f"p{number}")
        made.write(part, [pa.table(columns)], sources=[f"s{number}"])
    return made


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[str, int]]:
    """A scheduler and a worker with its nanny, each a process of its own; address and its pid."""
    found = tmp_path / "scheduler.json"
    common = ("--scheduler-file", str(found), "--no-dashboard")
    begun = [
        subprocess.Popen(
            (sys.executable, "-m", f"distributed.cli.dask_{which}", *options, *common),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            cwd=Path(__file__).resolve().parents[2],
        )
        for which, *options in (
            ("scheduler", "--port", "0", "--host", "127.0.0.1", "--no-show"),
            ("worker", "--nthreads", "1", "--nworkers", "2", "--local-directory", str(tmp_path)),
        )
    ]
    try:
        from distributed import Client

        with Client(scheduler_file=str(found), timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield json.loads(found.read_text())["address"], begun[0].pid
    finally:
        for process in begun:
            # With what it has started.
            os.killpg(process.pid, signal.SIGKILL)
            process.wait(timeout=30)


def shown(_: float) -> None:
    """Show nothing of the progress."""


def test_a_cluster_writes_the_same_bytes(
    archive: Archive, scheduler: tuple[str, int], tmp_path: Path
) -> None:
    there = tasks_of(Settle(), archive, to=tmp_path / "there")
    here = tasks_of(Settle(), archive, to=tmp_path / "here")
    rows = run_on_dask(there, scheduler=scheduler[0], show=shown)
    assert rows == sum(map(perform, here)) == PARTS * 3
    for one, other in zip(there, here, strict=True):
        assert one.target.read_bytes() == other.target.read_bytes()


def test_a_worker_killed_in_the_middle_changes_nothing(
    archive: Archive, scheduler: tuple[str, int], tmp_path: Path
) -> None:
    (tmp_path / "killed").mkdir()
    job = Killing(folder=tmp_path / "killed", times=1)
    there = tasks_of(job, archive, to=tmp_path / "there")
    here = tasks_of(job, archive, to=tmp_path / "here")
    run_on_dask(there, scheduler=scheduler[0], show=shown)
    assert (tmp_path / "killed" / "killed-0").exists()
    for one, other in zip(there, here, strict=True):
        perform(other)
        assert one.target.read_bytes() == other.target.read_bytes()


def test_a_part_that_kills_every_worker_is_named(
    archive: Archive, scheduler: tuple[str, int], tmp_path: Path
) -> None:
    (tmp_path / "killed").mkdir()
    job = Killing(folder=tmp_path / "killed", times=99)
    [task, *_] = tasks_of(job, archive, to=tmp_path / "out")
    with pytest.raises(ClusterError, match=r"p0.parquet: the process .* died each time; .* again"):
        run_on_dask([task], scheduler=scheduler[0], show=shown)
    assert not list((tmp_path / "out").rglob("*.parquet"))


def test_a_lost_scheduler_is_one_line_and_a_second_run_goes_on(
    archive: Archive, scheduler: tuple[str, int], tmp_path: Path
) -> None:
    (tmp_path / "killed").mkdir()
    address, pid = scheduler
    job = Killing(folder=tmp_path / "killed", times=1, pid=pid)
    tasks = tasks_of(job, archive, to=tmp_path / "out")
    with pytest.raises(ClusterError, match=r"does not answer; what is done is kept: .* run this"):
        run_on_dask(tasks, scheduler=address, show=shown)
    left = [task for task in tasks if not task.done]
    assert 0 < len(left) <= PARTS
    assert run_on_dask(left, scheduler=None, show=shown) > 0
    assert all(task.done for task in tasks)


def test_no_scheduler_at_an_address(archive: Archive, tmp_path: Path) -> None:
    tasks = tasks_of(Settle(), archive, to=tmp_path / "out")
    with pytest.raises(ClusterError, match=r"tcp://127.0.0.1:9 does not answer"):
        run_on_dask(tasks, scheduler="tcp://127.0.0.1:9", show=shown)
