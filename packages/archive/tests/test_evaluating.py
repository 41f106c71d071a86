"""Evaluating an archive: the same results on every engine and store, after every interruption."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import dask
import pandas as pd
import pytest
from distributed import LocalCluster
from packages.archive.tests import archive_jobs
from packages.archive.tests.drawn import DAYS, draw_archive, palpate, read, read_bytes

from palpate.errors import PalpateError
from palpate.recording import load_recording
from palpate_archive.catalogue import Catalogue
from palpate_archive.compacting import join_files
from palpate_archive.engine import perform
from palpate_archive.evaluating import enter_results, plan_tasks
from palpate_archive.folders import Folder
from palpate_archive.jobs import Job, create_recalibrate_job, create_settle_job
from palpate_archive.layout import open_archive

pytestmark = pytest.mark.slow

JOB = "settle-relaxation"


def open_scheduler(port: int = 0) -> LocalCluster:
    """Return a scheduler with a worker in a thread of this process."""
    return LocalCluster(
        n_workers=1,
        processes=False,
        scheduler_port=port,
        dashboard_address="127.0.0.1:0",
        protocol="tcp",
    )


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    with open_scheduler() as cluster:
        yield cluster.scheduler_address


def run_plainly(job: Job, archive: Folder, to: Path) -> dict[str, bytes]:
    """Evaluate in a plain loop; return the bytes of the results."""
    folder = Folder.open(to)
    tasks = plan_tasks(job, archive, to=folder)
    entries = [task.perform() for task in tasks]
    enter_results(Catalogue(folder, job.name), entries, of=Catalogue(archive, job.reads))
    return read_bytes(to, job.name)


def test_results_are_equal_in_folder_and_s3(scheduler: str, bucket: str, tmp_path: Path) -> None:
    root, away = tmp_path / "a", f"{bucket}/a"
    draw_archive(root, stations=("north",)), draw_archive(away, stations=("north",))
    plain = run_plainly(
        create_settle_job(method="relaxation", horizon_s=10.0), open_archive(root), root
    )
    for address in (str(root), away):
        settle = ("archive", "settle", address, "--horizon", "10", "--scheduler", scheduler)
        assert palpate(*settle) == 0
        assert read_bytes(f"{address}/results", JOB) == plain
    known = {"ok", "unproven", "too_short", "misfit", "not_settling", "fell_back"}
    for table in read(root, JOB).values():
        assert set(table["status"]) <= known


def test_second_run_computes_only_what_is_new(scheduler: str, tmp_path: Path) -> None:
    root = tmp_path / "a"
    archive = draw_archive(root, stations=("north",))
    settle = ("archive", "settle", str(root), "--scheduler", scheduler)
    assert palpate(*settle, "--horizon", "10") == 0
    folder = Folder.open(root / "results")
    other = plan_tasks(create_settle_job(method="relaxation", horizon_s=12.0), archive, to=folder)
    same = plan_tasks(create_settle_job(method="relaxation", horizon_s=10.0), archive, to=folder)
    catalogue = Catalogue(folder, JOB)
    listed = {entry.file for entry in catalogue.files()}
    assert listed == {task.target for task in same}
    assert listed.isdisjoint(task.target for task in other)
    # A result that was written but not entered is not computed again.
    times = {file: (root / "results" / file).stat().st_mtime_ns for file in folder.find(JOB)}
    catalogue.change("north", lambda before: before[1:])
    assert palpate(*settle, "--horizon", "10") == 0
    assert len(catalogue.files()) == len(same)
    assert times == {
        file: (root / "results" / file).stat().st_mtime_ns for file in folder.find(JOB)
    }


def test_results_of_joined_files_replace_those_of_pieces(scheduler: str, tmp_path: Path) -> None:
    root = tmp_path / "a"
    archive = draw_archive(root, stations=("north",))
    settle = ("archive", "settle", str(root), "--horizon", "10", "--scheduler", scheduler)
    assert palpate(*settle) == 0
    before = read(root / "results", JOB)
    join_files(archive, "holds", grace_s=0.0)
    assert read(root / "results", JOB).keys() == before.keys()
    assert palpate(*settle) == 0
    after = read(root / "results", JOB)
    assert len(after) == len(DAYS)
    rows = ["recording", "hold_id", "cutoff_s"]
    expected, found = (
        pd.concat(each.values()).set_index(rows).sort_index() for each in (before, after)
    )
    # Holds of one file are predicted together, which may change the last bits.
    pd.testing.assert_frame_equal(found, expected, rtol=1e-9)


def read_results(to: Folder, job: Job) -> dict[str, bytes]:
    """Return all finished files of a job, listed or not: place -> bytes."""
    return dict(to.fs.cat(to.find(job.name)))


@pytest.mark.parametrize("store", ["folder", "s3"])
def test_two_processes_of_which_one_is_killed_write_the_bytes_of_a_plain_loop(
    store: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    address = str(tmp_path) if store == "folder" else request.getfixturevalue("bucket")
    archive, job = draw_archive(f"{address}/a"), archive_jobs.killing_job(tmp_path)
    to = Folder.open(f"{address}/out")
    tasks = plan_tasks(job, archive, to=to)
    shown = list[float]()
    entries = perform(tasks, show=shown.append, workers=2)
    assert (tmp_path / "killed").exists()
    assert shown == [*range(1, len(tasks) + 1)]
    assert [entry.file for entry in entries] == [task.target for task in tasks]
    assert read_results(to, job) == run_plainly(job, archive, tmp_path / "plain")


@pytest.mark.skipif(sys.platform != "linux", reason="for the allocator of glibc")
def test_worker_process_reuses_the_memory_of_large_arrays(tmp_path: Path) -> None:
    """With Dask's settings each array of 2 MB would be mapped again, in 512 pages."""
    archive = draw_archive(tmp_path / "a", stations=("north",))
    tasks = plan_tasks(archive_jobs.faulting_job(), archive, to=Folder.open(tmp_path / "out"))[:1]
    perform(tasks, show=lambda _: None, workers=1)
    [file] = (tmp_path / "out").rglob("*.parquet")
    assert pd.read_parquet(file)["faults"][0] < 100


def test_task_that_kills_every_worker_is_named(tmp_path: Path) -> None:
    archive = draw_archive(tmp_path / "a", stations=("north",))
    tasks = plan_tasks(
        archive_jobs.killing_job(tmp_path, always=True),
        archive,
        to=Folder.open(tmp_path / "out"),
    )[:1]
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        pytest.raises(PalpateError, match=r"killing/station=north.*lack of memory"),
    ):
        perform(tasks, show=lambda _: None, workers=1)


def test_restarted_scheduler_gets_the_remaining_tasks(tmp_path: Path) -> None:
    archive, job = draw_archive(tmp_path / "a"), archive_jobs.waiting_job()
    to = Folder.open(tmp_path / "out")
    tasks = plan_tasks(job, archive, to=to)
    cluster = open_scheduler()
    address = cluster.scheduler_address
    found = list[int]()
    lines = list[str]()

    def run() -> None:
        entries = perform(tasks, show=lambda _: None, scheduler=address, report=lines.append)
        found.append(len(entries))

    client = threading.Thread(target=run)
    client.start()
    assert archive_jobs.STARTED.wait(30)
    # The first task still waits when the scheduler goes.
    threading.Timer(0.5, archive_jobs.GO_ON.set).start()
    cluster.close()
    with open_scheduler(int(address.rpartition(":")[2])):
        client.join(60)
    assert found == [len(tasks)]
    assert any("lost the scheduler" in line for line in lines)
    assert read_results(to, job) == run_plainly(job, archive, tmp_path / "plain")


def test_worker_with_other_code_is_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    archive = draw_archive(tmp_path / "a", stations=("north",))
    to = Folder.open(tmp_path / "out")
    task = plan_tasks(archive_jobs.copying_job(), archive, to=to)[0]
    older = replace(task, code=task.code | {"palpate": "0.0.1"})
    with pytest.raises(PalpateError, match=r"other code.*palpate 0\.0\.1"):
        older.perform()


def test_recalibrate_with_own_calibration_reproduces_force(
    root: Path, recorded: Path, tmp_path: Path
) -> None:
    recording = load_recording(recorded / "g1.mcap")
    assert recording.info.calibration is not None
    job = create_recalibrate_job(recording.info.calibration)
    plain = run_plainly(job, open_archive(root), tmp_path / "out")
    to = Folder.open(tmp_path / "two")
    perform(plan_tasks(job, open_archive(root), to=to), show=lambda _: None, workers=2)
    assert read_results(to, job) == plain
    [first] = [t for place, t in read(tmp_path / "out", job.name).items() if "/g1-" in place]
    assert first["time_s"].tolist() == recording.time_s.tolist()
    assert (first["force_n_low"] <= first["force_n"]).all()
    # A gentle squeeze: a maximum of some newtons, and no force at the start.
    assert 1.0 < first["force_n"].max() < 6.0
    assert first["force_n"][:10].max() < 0.3
