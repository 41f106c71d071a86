"""Evaluate a whole archive, with one atomically written result file per part.

The results do not depend on the order or the number of processes, and a second run evaluates only
new and changed parts.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet
from threadpoolctl import threadpool_limits

from palpate.arrays import FloatArray
from palpate.errors import PalpateError
from palpate_archive.layout import Archive, write_tables

#: Cut-offs of the settled-value predictions, seconds after the start of a hold.
CUTOFFS_S = (1.0, 2.5, 5.0)
#: Rows of frames in memory at once.
_BATCH = 50_000
_LEVEL = 0.9
_JOB = b"palpate.job"


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One kind of evaluation; it must be picklable."""

    #: Name of the folder of results.
    name: str
    #: Kind of the parts to evaluate.
    reads: str
    #: Settings that determine the results, besides the part and the version of palpate.
    settings: str
    #: Yields the results of one part as at least one table of one schema.
    tables: Callable[[Path], Iterator[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One part and the file of its results."""

    job: Job
    source: Path
    target: Path
    #: Identifies the job and the part in the file of results.
    mark: str

    @property
    def is_done(self) -> bool:
        """Whether the results exist."""
        try:
            marks = pa.parquet.read_schema(self.target).metadata or {}
        except (OSError, ValueError):
            return False
        return bool(marks.get(_JOB) == self.mark.encode())

    def perform(self) -> int:
        """Write the results; return the number of rows."""
        # More threads would change the order of sums, and so the last bits between machines.
        with threadpool_limits(limits=1):
            return write_tables(self.target, self.job.tables(self.source), marks={_JOB: self.mark})


def plan_tasks(job: Job, archive: Archive, *, to: Path) -> list[Task]:
    """Return a task for each part of the job's kind."""
    identity = f"{job.name}\n{version('palpate')}\n{job.settings}"
    digest = hashlib.sha256(identity.encode()).hexdigest()
    tasks = []
    for part in archive.parts(job.reads):
        source = archive.path(part)
        place = to / job.name / Path(*part.place.parts[1:])
        mark = {"job": digest, "part": str(part.place), "bytes": source.stat().st_size}
        tasks.append(Task(job=job, source=source, target=place, mark=json.dumps(mark)))
    return tasks


def perform(
    tasks: Sequence[Task], *, show: Callable[[float], None], workers: int | None = None
) -> int:
    """Perform tasks on all cores; return the number of rows written.

    Raises `PalpateError` if a process died, for example without enough memory.
    """
    rows = 0
    with ProcessPoolExecutor(workers or os.cpu_count(), mp_context=get_context("spawn")) as pool:
        try:
            futures = [pool.submit(Task.perform, task) for task in tasks]
            for number, future in enumerate(as_completed(futures), start=1):
                rows += future.result()
                show(number)
        except BrokenProcessPool as error:
            raise PalpateError(
                "a process of the archive died, possibly from a lack of memory; run it again to "
                "continue with the remaining parts"
            ) from error
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return rows


def delete_stale_results(results: Path, tasks: Sequence[Task]) -> None:
    """Delete results of parts that no longer exist, such as parts joined since."""
    current = {task.target for task in tasks}
    for path in results.rglob("[!.]*.parquet"):
        if path not in current and _JOB in (pa.parquet.read_schema(path).metadata or {}):
            path.unlink()


# -- settle ----------------------------------------------------------------------------------------


def create_settle_job(*, method: str, horizon_s: float) -> Job:
    """Return a job that predicts the settled value of every hold."""
    return Job(
        name=f"settle-{method}",
        reads="holds",
        settings=f"{method} {CUTOFFS_S} {horizon_s} {_LEVEL}",
        tables=partial(_build_settled_tables, method=method, horizon_s=horizon_s),
    )


def _build_settled_tables(path: Path, *, method: str, horizon_s: float) -> Iterator[Any]:
    """Yield one table: a row for each hold, channel and cut-off."""
    names = ["recording", "hold_id", "channel", "unit", "time_s", "value"]
    table = pa.parquet.read_table(path, columns=names, partitioning=None, use_threads=False)
    rows = [
        row
        for alike in _group_holds(table)
        for row in _build_settled_rows(*alike, method=method, horizon_s=horizon_s)
    ]
    text = ("recording", "hold_id", "channel", "unit", "status")
    numbers = ("cutoff_s", "value", "low", "high", "level", "settled")
    order = (*text[:4], *numbers[:5], "status", "settled")
    kinds = dict.fromkeys(text, pa.string()) | dict.fromkeys(numbers, pa.float64())
    yield pa.Table.from_pylist(rows, schema=pa.schema([(name, kinds[name]) for name in order]))


def _build_settled_rows(
    labels: list[tuple[str, ...]],
    time_s: FloatArray,
    values: FloatArray,
    *,
    method: str,
    horizon_s: float,
) -> Iterator[dict[str, Any]]:
    from palpate.holds import measure_settled_value
    from palpate.settling.predict import predict_settled

    settled = [measure_settled_value(time_s, each, horizon_s=horizon_s) for each in values]
    for cutoff_s in CUTOFFS_S:
        if not time_s[0] <= cutoff_s <= time_s[-1]:
            continue
        found = predict_settled(
            time_s,
            values,
            cutoff_s=cutoff_s,
            horizon_s=horizon_s,
            method=method,
            level=_LEVEL,
            unit=labels[0][-1],
        )
        for index, names in enumerate(labels):
            one = found.hold(index)
            yield dict(zip(("recording", "hold_id", "channel", "unit"), names, strict=True)) | {
                "cutoff_s": cutoff_s,
                "value": float(one.value),
                "low": float(one.low),
                "high": float(one.high),
                "level": _LEVEL,
                "status": str(one.status),
                "settled": None if np.isnan(settled[index]) else float(settled[index]),
            }


def _group_holds(table: Any) -> Iterator[tuple[list[tuple[str, ...]], FloatArray, FloatArray]]:
    """Yield groups of holds with one unit and sampling: labels, times, values (holds, times)."""
    columns = [table[name].combine_chunks() for name in ("recording", "hold_id", "channel", "unit")]
    changes = np.zeros(max(table.num_rows - 1, 0), dtype=bool)
    for column in columns:
        differs = pyarrow.compute.not_equal(column[1:], column[:-1])
        changes |= differs.to_numpy(zero_copy_only=False)
    starts = [0, *(np.flatnonzero(changes) + 1).tolist()]
    labels = list(zip(*(column.take(starts).to_pylist() for column in columns), strict=True))
    time_s, value = (table[name].to_numpy() for name in ("time_s", "value"))
    groups = defaultdict[tuple[str, bytes], list[tuple[int, slice]]](list)
    for number, (start, stop) in enumerate(pairwise([*starts, table.num_rows])):
        rows = slice(start, stop)
        groups[labels[number][-1], time_s[rows].tobytes()].append((number, rows))
    for holds in groups.values():
        values = np.stack([value[rows] for _, rows in holds])
        yield [labels[number] for number, _ in holds], time_s[holds[0][1]], values


# -- recalibrate -----------------------------------------------------------------------------------


def create_recalibrate_job(calibration: str) -> Job:
    """Return a job that estimates the force of every frame with one calibration file."""
    return Job(
        name=f"force-{hashlib.sha256(calibration.encode()).hexdigest()[:8]}",
        reads="frames",
        settings=calibration,
        tables=partial(_build_force_tables, text=calibration),
    )


def _build_force_tables(path: Path, *, text: str) -> Iterator[Any]:
    """Yield tables with a row per frame; other layouts have no force."""
    from palpate.calibrate.laws import force_now
    from palpate.sensor.calibration import Calibration
    from palpate.sensor.sample import SampleReader

    calibration = Calibration.from_text(text)
    reader = SampleReader(calibration.layout, calibration.rest.ohm)
    shape = (calibration.layout.rows, calibration.layout.cols)
    names = ("time_s", "force_n", "force_n_low", "force_n_high")
    schema = pa.schema([("recording", pa.string()), *((name, pa.float64()) for name in names)])
    now, recording = force_now(calibration), None
    with pa.parquet.ParquetFile(path) as file:
        for batch in file.iter_batches(
            _BATCH, columns=["recording", "time_s", "rows", "cols", "ohm"], use_threads=False
        ):
            rows = []
            for frame in batch.to_pylist():
                if frame["recording"] != recording:
                    recording, now = frame["recording"], force_now(calibration)
                row = {"recording": recording, "time_s": frame["time_s"]}
                if (frame["rows"], frame["cols"]) == shape:
                    ohm = np.array(frame["ohm"], dtype=float).reshape(shape)
                    pixels = reader.read_ohm(ohm)
                    force = now.step(
                        frame["time_s"],
                        pixels.excess,
                        saturated=pixels.has_saturated,
                        lost=pixels.has_lost,
                    )
                    row |= dict(zip(names[1:], (force.value, force.low, force.high), strict=True))
                rows.append(row)
            yield pa.Table.from_pylist(rows, schema=schema)
