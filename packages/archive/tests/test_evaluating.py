"""Evaluating an archive: the same results on every engine and store, after every interruption."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import dask
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
    before = sum(len(table) for table in read(root / "results", JOB).values())
    join_files(archive, "holds", grace_s=0.0)
    assert sum(len(table) for table in read(root / "results", JOB).values()) == before
    assert palpate(*settle) == 0
    after = read(root / "results", JOB)
    assert len(after) == len(DAYS)
    assert sum(len(table) for table in after.values()) == before


def test_killed_worker_is_replaced(tmp_path: Path) -> None:
    """In processes of this computer."""
    archive = draw_archive(tmp_path / "a")
    expected = run_plainly(archive_jobs.copying_job(), archive, tmp_path / "plain")
    tasks = plan_tasks(
        archive_jobs.killing_job(tmp_path), archive, to=Folder.open(tmp_path / "out")
    )
    shown = list[float]()
    entries = perform(tasks, show=shown.append, workers=1)
    assert (tmp_path / "killed").exists()
    assert shown == [*range(1, len(tasks) + 1)]
    assert sum(entry.rows for entry in entries) == sum(
        len(table) for table in read(tmp_path / "plain", "copying").values()
    )
    assert len(entries) == len(expected)


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
    archive = draw_archive(tmp_path / "a")
    tasks = plan_tasks(archive_jobs.waiting_job(), archive, to=Folder.open(tmp_path / "out"))
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
    run_plainly(job, open_archive(root), tmp_path / "out")
    [first] = [t for place, t in read(tmp_path / "out", job.name).items() if "/g1-" in place]
    assert first["time_s"].tolist() == recording.time_s.tolist()
    assert (first["force_n_low"] <= first["force_n"]).all()
    # A gentle squeeze: a maximum of some newtons, and no force at the start.
    assert 1.0 < first["force_n"].max() < 6.0
    assert first["force_n"][:10].max() < 0.3
