"""Evaluation of an archive: a plain loop, and a Dask scheduler with one and with two workers.

    python benchmarks/archive.py --folder /big/disk/archive

The holds are drawn (no sensor, no twin): 2000 samples at 100 Hz that creep with the logarithm of
time. The frames are those of one simulated grasp, repeated. `settle` and `recalibrate` run on them
in a plain loop of one process, and on a scheduler with one and with two worker processes, which
are already started. The default numbers take a loop about 20 s each; shorter runs measure the
connection to the scheduler too. The peak is the largest memory of one process. All results must be
identical. With `--folder` the archive stays there, and a second run measures at once.
"""

from __future__ import annotations

import argparse
import hashlib
import logging
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import dask
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from distributed import Client, LocalCluster

from palpate.recording import RecordingReader
from palpate_archive.adding import add_recordings
from palpate_archive.catalogue import Catalogue, Part
from palpate_archive.engine import LOCAL_CONFIG, perform
from palpate_archive.evaluating import Task, plan_tasks
from palpate_archive.folders import Folder
from palpate_archive.jobs import Job, create_recalibrate_job, create_settle_job
from palpate_archive.layout import open_archive, write_tables

PER_HOLD, HOLDS_PER_FILE, FRAMES_PER_FILE = 2000, 500, 5000


def draw_holds(archive: Folder, *, holds: int) -> None:
    """Write drawn holds."""
    rng = np.random.default_rng(3)
    time_s = np.arange(PER_HOLD) / 100
    for number in range(max(holds // HOLDS_PER_FILE, 1)):
        fall = rng.uniform(100.0, 600.0, (HOLDS_PER_FILE, 1))
        start_s = rng.uniform(0.1, 1.0, (HOLDS_PER_FILE, 1))
        values = 9000.0 - fall * np.log(time_s + start_s)
        values += rng.normal(0.0, 3.0, values.shape)
        names = [f"h{number}-{hold}" for hold in range(HOLDS_PER_FILE)]
        columns = {
            "recording": np.full(values.size, f"r{number}"),
            "hold_id": np.repeat(names, PER_HOLD),
            "time_s": np.tile(time_s, HOLDS_PER_FILE),
            "value": values.ravel(),
            "channel": np.full(values.size, "mean"),
            "unit": np.full(values.size, "ohm"),
        }
        write(archive, "holds", number, pa.table(columns))


def repeat_frames(archive: Folder, *, frames: int, folder: Path) -> str:
    """Write the frames of a simulated grasp again and again; return its calibration."""
    recording = folder / "one.mcap"
    command = ["grasp", "--rig", "sim-rigid", "--seed", "1", "--record", str(recording)]
    subprocess.run(
        [sys.executable, "-m", "palpate", *command], check=True, stdout=subprocess.DEVNULL
    )
    one = open_archive(folder / "one", create=True)
    list(add_recordings(one, [recording]))
    [entry] = Catalogue(one, "frames").files()
    table = one.read_table(entry.file)
    at = table.column_names.index("recording")
    for number in range(max(frames // FRAMES_PER_FILE, 1)):
        copies = [
            table.set_column(at, "recording", pa.array([f"r{number}-{copy}"] * len(table)))
            for copy in range(-(-FRAMES_PER_FILE // len(table)))
        ]
        write(archive, "frames", number, pa.concat_tables(copies)[:FRAMES_PER_FILE])
    with RecordingReader(recording) as reader:
        assert reader.info.calibration is not None
        return reader.info.calibration


def write(archive: Folder, kind: str, number: int, table: pa.Table) -> None:
    place = Part(kind, "drawn", "2026-01-01", f"p{number:04}").place
    entry = write_tables(archive, place, [table], sources=[f"{kind}{number}"])
    Catalogue(archive, kind).add([entry])


def warm_up(task: Task) -> None:
    """Compute the results of a file without writing them."""
    with task.archive.fetch(task.source.file) as path:
        list(task.job.tables(path))


def run_plainly(tasks: list[Task]) -> tuple[float, float, float]:
    """Perform tasks one after another; return seconds, processor seconds and peak memory, GB."""
    warm_up(tasks[0])
    started_s, used_s = time.perf_counter(), time.process_time()
    for task in tasks:
        task.perform()
    return time.perf_counter() - started_s, time.process_time() - used_s, measure_peak_gb()


def run_on_workers(tasks: list[Task], *, workers: int) -> tuple[float, float, float]:
    """Perform tasks on a scheduler; return the same, for all workers and for the largest one."""
    with (
        suppress(TimeoutError),  # of the end of a worker on a busy machine
        dask.config.set(LOCAL_CONFIG),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        with Client(cluster) as client:
            # Imports are not counted, as in the loop.
            client.run(warm_up, tasks[0])
            used_s = sum(client.run(time.process_time).values())
        started_s = time.perf_counter()
        perform(tasks, show=lambda _: None, scheduler=cluster.scheduler_address)
        taken_s = time.perf_counter() - started_s
        with Client(cluster) as client:
            used_s = sum(client.run(time.process_time).values()) - used_s
            found = taken_s, used_s, max(client.run(measure_peak_gb).values())
    return found


def measure_peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def hash_results(results: Path) -> dict[str, str]:
    """Return place -> hash of the bytes of each file."""
    return {
        file.relative_to(results).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(results.rglob("*.parquet"))
    }


def describe_difference(one: Path, two: Path) -> str:
    """Return the first difference between the results of two runs; empty if there is none."""
    hashes, others = hash_results(one), hash_results(two)
    if only := sorted(hashes.keys() ^ others.keys()):
        return f"only one run has {only[0]}"
    differing = [place for place in hashes if hashes[place] != others[place]]
    if not differing:
        return ""
    text = f"{len(differing)} of {len(hashes)} files differ; {differing[0]}"
    tables = [pq.read_table(folder / differing[0], partitioning=None) for folder in (one, two)]
    frames = [table.to_pandas() for table in tables]
    if frames[0].shape != frames[1].shape:
        return f"{text}: shapes {frames[0].shape} and {frames[1].shape}"
    for column in frames[0]:
        first, second = (frame[column] for frame in frames)
        unequal = np.flatnonzero((first != second) & ~(first.isna() & second.isna()))
        if unequal.size:
            row = unequal[0]
            pair = f"{first[row]!r} and {second[row]!r}"
            return f"{text}: {unequal.size} rows of {column}, row {row}: {pair}"
    return (
        f"{text}: equal values, metadata {tables[0].schema.metadata} and "
        f"{tables[1].schema.metadata}"
    )


def compare(job: Job, archive: Folder, folder: Path, *, count: int, unit: str, rounds: int) -> bool:
    """Print the rates of a job; return whether all results are identical.

    Results that differ from those of the first plain loop stay in the folder.
    """
    is_same, reference = True, folder / f"{job.name}-0-0"
    for number in range(rounds):
        seconds = {}
        for workers in (0, 1, 2):
            results = folder / f"{job.name}-{number}-{workers}"
            # Of an interrupted run, which would be skipped now.
            shutil.rmtree(results, ignore_errors=True)
            tasks = plan_tasks(job, archive, to=Folder.open(results))
            run = run_on_workers(tasks, workers=workers) if workers else run_plainly(tasks)
            seconds[workers], used_s, peak_gb = run
            name = f"{workers} worker(s)" if workers else "plain loop"
            print(
                f"{job.name}, {name}: {seconds[workers]:.1f} s, {used_s:.1f} s of processors, "
                f"{count / seconds[workers]:.0f} {unit}/s, "
                f"{seconds[0] / seconds[workers]:.2f} of the plain loop, peak {peak_gb:.2f} GB, "
                f"load of the machine {os.getloadavg()[0]:.1f}",
                flush=True,
            )
            if difference := describe_difference(reference, results):
                is_same = False
                print(f"DIFFERENT: {results.name}: {difference}", flush=True)
            elif results != reference:
                shutil.rmtree(results)
    if is_same:
        shutil.rmtree(reference)
    return is_same


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--holds", type=int, default=100_000)
    parser.add_argument("--frames", type=int, default=160_000)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="folder of the archive, which stays")
    parser.add_argument("--draw-only", action="store_true", help="only write the archive")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        saved = folder / "calibration.json"
        archive = open_archive(folder / "archive", create=True)
        if not saved.exists():
            draw_holds(archive, holds=options.holds)
            saved.write_text(repeat_frames(archive, frames=options.frames, folder=folder))
        if options.draw_only:
            return
        settle = create_settle_job(method="relaxation", horizon_s=19.0)
        force = create_recalibrate_job(saved.read_text())
        same = []
        for job, per, unit in ((settle, PER_HOLD, "holds"), (force, 1, "frames")):
            count = sum(entry.rows for entry in Catalogue(archive, job.reads).files()) // per
            same.append(
                compare(job, archive, folder, count=count, unit=unit, rounds=options.rounds)
            )
        print("identical results" if all(same) else "DIFFERENT results")
        sys.exit(not all(same))


if __name__ == "__main__":
    main()
