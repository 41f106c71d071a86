"""The jobs: what is computed from one file of an archive, on one thread."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial, reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet

from palpate.arrays import FloatArray

#: Cut-offs of the settled-value predictions, seconds after the start of a hold.
CUTOFFS_S = (1.0, 2.5, 5.0)
#: Rows of frames in memory at once.
_BATCH = 50_000
_LEVEL = 0.9
#: Columns that name a hold.
_LABELS = ["recording", "hold_id", "channel", "unit"]
_SETTLED = pa.schema(
    dict.fromkeys(_LABELS, pa.string())
    | dict.fromkeys(("cutoff_s", "value", "low", "high", "level"), pa.float64())
    | {"status": pa.string(), "settled": pa.float64()}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One kind of evaluation; it must be picklable."""

    #: Name of the folder of results.
    name: str
    #: Kind of the files to evaluate.
    reads: str
    #: Settings that determine the results, besides the file and the code; values of JSON.
    settings: dict[str, object]
    #: Yields the results of one file as at least one table of one schema.
    tables: Callable[[Path], Iterator[Any]]


# -- settle ----------------------------------------------------------------------------------------


def create_settle_job(*, method: str, horizon_s: float) -> Job:
    """Return a job that predicts the settled value of every hold."""
    return Job(
        name=f"settle-{method}",
        reads="holds",
        settings={
            "method": method,
            "horizon_s": horizon_s,
            "cutoffs_s": CUTOFFS_S,
            "level": _LEVEL,
        },
        tables=partial(_build_settled_tables, method=method, horizon_s=horizon_s),
    )


def _build_settled_tables(path: Path, *, method: str, horizon_s: float) -> Iterator[Any]:
    """Yield one table: a row for each hold, channel and cut-off."""
    names = [*_LABELS, "time_s", "value"]
    # `pa.parquet.read_table` decodes in other threads even with `use_threads=False`.
    with pa.parquet.ParquetFile(path, read_dictionary=_LABELS) as file:
        table = file.read(columns=names, use_threads=False)
    rows = [
        row
        for alike in _group_holds(table)
        for row in _build_settled_rows(*alike, method=method, horizon_s=horizon_s)
    ]
    yield pa.Table.from_pylist(rows, schema=_SETTLED)


def _build_settled_rows(
    labels: list[dict[str, str]],
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
            unit=labels[0]["unit"],
        )
        for index, names in enumerate(labels):
            one = found.hold(index)
            yield names | {
                "cutoff_s": cutoff_s,
                "value": float(one.value),
                "low": float(one.low),
                "high": float(one.high),
                "level": _LEVEL,
                "status": str(one.status),
                "settled": None if np.isnan(settled[index]) else float(settled[index]),
            }


def _group_holds(table: Any) -> Iterator[tuple[list[dict[str, str]], FloatArray, FloatArray]]:
    """Yield groups of holds with one unit and sampling: labels, times, values (holds, times).

    `table`: its labels are dictionary arrays.
    """
    names = table.select(_LABELS)
    # Within a column equal strings have one index; null has none.
    indices = [column.combine_chunks().indices.fill_null(-1) for column in names.columns]
    changes = reduce(pc.or_, (pc.not_equal(column[1:], column[:-1]) for column in indices))
    starts = [0, *(np.flatnonzero(changes) + 1).tolist(), table.num_rows]
    labels = names.take(starts[:-1]).to_pylist()
    time_s, value = (table[name].to_numpy() for name in ("time_s", "value"))
    rows = [slice(*bounds) for bounds in pairwise(starts)]
    groups = defaultdict[tuple[str, bytes], list[int]](list)
    for number, label in enumerate(labels):
        groups[label["unit"], time_s[rows[number]].tobytes()].append(number)
    for numbers in groups.values():
        values = np.stack([value[rows[number]] for number in numbers])
        yield [labels[number] for number in numbers], time_s[rows[numbers[0]]], values


# -- recalibrate -----------------------------------------------------------------------------------


def create_recalibrate_job(calibration: str) -> Job:
    """Return a job that estimates the force of every frame with one calibration file."""
    digest = hashlib.sha256(calibration.encode()).hexdigest()
    return Job(
        name=f"force-{digest[:8]}",
        reads="frames",
        settings={"calibration_sha256": digest},
        tables=partial(_build_force_tables, text=calibration),
    )


def _build_force_tables(path: Path, *, text: str) -> Iterator[Any]:
    """Yield tables with a row per frame; other layouts have no force."""
    from palpate.calibration import Calibration
    from palpate.force.of_calibration import force_now
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
