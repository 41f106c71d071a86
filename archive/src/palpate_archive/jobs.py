"""Jobs on every part of an archive: each makes one table of one part."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from palpate.arrays import FloatArray
from palpate.errors import InputError

#: Rows of frames in memory at once.
_BATCH = 50_000


class Job(Protocol):
    """One kind of work; a value that is sent to other processes."""

    @property
    def name(self) -> str:
        """Folder of its results."""
        ...

    @property
    def reads(self) -> str:
        """Kind of the parts that it works on."""
        ...

    @property
    def settings(self) -> str:
        """All that its results depend on, besides the part and the version of palpate."""
        ...

    def tables(self, path: Path) -> Iterator[Any]:
        """Yield the results of one part, tables of one schema; at least one."""
        ...


def digest(job: Job) -> str:
    """Return what changes whenever the results of a job may change."""
    identity = f"{job.name}\n{version('palpate')}\n{job.settings}"
    return hashlib.sha256(identity.encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Settle:
    """Predict the settled value of every hold again, and score it where the hold is long enough."""

    method: str = "relaxation"
    cutoffs_s: tuple[float, ...] = (1.0, 2.5, 5.0)
    horizon_s: float = 20.0
    level: float = 0.9

    @property
    def name(self) -> str:
        """Folder of its results."""
        return f"settle-{self.method}"

    @property
    def reads(self) -> str:
        """Kind of the parts that it works on."""
        return "holds"

    @property
    def settings(self) -> str:
        """All that its results depend on."""
        return repr(self)

    def tables(self, path: Path) -> Iterator[Any]:
        """Yield one table: a row for each hold, channel and cut-off."""
        names = ["recording", "hold_id", "channel", "unit", "time_s", "value"]
        table = pa.parquet.read_table(path, columns=names, partitioning=None, use_threads=False)
        rows = [row for alike in _alike(table) for row in self._rows(*alike)]
        yield pa.Table.from_pylist(rows, schema=_settled_schema())

    def _rows(
        self, labels: list[tuple[str, ...]], time_s: FloatArray, values: FloatArray
    ) -> Iterator[dict[str, Any]]:
        from palpate.holds import settled_value
        from palpate.settling.predict import predict_settled

        unit = labels[0][-1]
        settled = [settled_value(time_s, each, horizon_s=self.horizon_s) for each in values]
        for cutoff_s in self.cutoffs_s:
            if not time_s[0] <= cutoff_s <= time_s[-1]:
                continue
            found = predict_settled(
                time_s,
                values,
                cutoff_s=cutoff_s,
                horizon_s=self.horizon_s,
                method=self.method,
                level=self.level,
                unit=unit,
            )
            for index, (recording, hold_id, channel, _) in enumerate(labels):
                one = found.hold(index)
                yield {
                    "recording": recording,
                    "hold_id": hold_id,
                    "channel": channel,
                    "unit": unit,
                    "cutoff_s": cutoff_s,
                    "value": float(one.value),
                    "low": float(one.low),
                    "high": float(one.high),
                    "level": self.level,
                    "status": str(one.status),
                    "settled": None if np.isnan(settled[index]) else float(settled[index]),
                }


@dataclass(frozen=True, slots=True, kw_only=True)
class Recalibrate:
    """Read the force of every frame again, by one calibration."""

    #: Text of the calibration file.
    calibration: str
    level: float = 0.9

    @property
    def name(self) -> str:
        """Folder of its results."""
        return f"force-{hashlib.sha256(self.calibration.encode()).hexdigest()[:8]}"

    @property
    def reads(self) -> str:
        """Kind of the parts that it works on."""
        return "frames"

    @property
    def settings(self) -> str:
        """All that its results depend on."""
        return repr(self)

    def tables(self, path: Path) -> Iterator[Any]:
        """Yield tables with a row for each frame; null where another sensor made the frame."""
        from palpate.grasp.planning import force_now
        from palpate.sensor.calibration import Calibration
        from palpate.signal.relative import excess_conductance

        calibration = Calibration.from_text(self.calibration)
        shape = (calibration.layout.rows, calibration.layout.cols)
        now, recording = force_now(calibration.force), None
        with pa.parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(
                _BATCH,
                columns=["recording", "time_s", "rows", "cols", "ohm"],
                use_threads=False,
            ):
                rows = []
                for frame in batch.to_pylist():
                    if frame["recording"] != recording:
                        recording, now = frame["recording"], force_now(calibration.force)
                    row = {"recording": recording, "time_s": frame["time_s"]}
                    if (frame["rows"], frame["cols"]) == shape:
                        ohm = np.array(frame["ohm"], dtype=float).reshape(shape)
                        excess = excess_conductance(ohm, rest_ohm=calibration.rest.ohm)
                        force = now.step(frame["time_s"], excess)
                        row |= {
                            "force_n": force.value,
                            "force_n_low": force.low,
                            "force_n_high": force.high,
                        }
                    rows.append(row)
                yield pa.Table.from_pylist(rows, schema=_force_schema())


@dataclass(frozen=True, slots=True, kw_only=True)
class Judge:
    """Decide again which bin each grasp alone would have sent its item to, by one file of rules."""

    #: The rules file, which every worker reads.
    rules: Path
    #: Its text, so that other rules are other results.
    text: str

    @property
    def name(self) -> str:
        """Folder of its results."""
        return f"bins-{hashlib.sha256(self.text.encode()).hexdigest()[:8]}"

    @property
    def reads(self) -> str:
        """Kind of the parts that it works on."""
        return "grasps"

    @property
    def settings(self) -> str:
        """All that its results depend on."""
        return self.text

    def tables(self, path: Path) -> Iterator[Any]:
        """Yield one table: a row for each grasp."""
        from palpate.produce.sorting.rules import decide
        from palpate.produce.sorting.rules_file import read_rules

        if self.rules.read_text() != self.text:
            raise InputError(f"{self.rules}: changed while it was used; run it again")
        book = read_rules(self.rules)
        rows = []
        for grasp in pa.parquet.read_table(path, partitioning=None, use_threads=False).to_pylist():
            decision = decide(book, _evidence(grasp))
            rows.append(
                {
                    "grasp_id": grasp["grasp_id"],
                    "item_id": grasp["item_id"],
                    "bin": decision.bin,
                    "probability": decision.probability,
                    "why": decision.why,
                }
            )
        yield pa.Table.from_pylist(rows, schema=_bin_schema())


def _evidence(grasp: dict[str, Any]) -> Any:
    """Return what one grasp alone shows: the kind, if a person stated it, and the size."""
    from palpate.estimate.measurement import Measurement
    from palpate.produce.identify.identifier import label_identity
    from palpate.produce.sorting.conditions import Evidence
    from palpate.settling.result import Status

    size = None
    if grasp["size_mm"] is not None:
        size = Measurement(
            value=grasp["size_mm"],
            low=grasp["size_mm_low"],
            high=grasp["size_mm_high"],
            unit="mm",
            status=Status(grasp["size_mm_status"]),
        )
    identity = label_identity(grasp["kind"]) if grasp["kind"] else None
    return Evidence(identity=identity, size_mm=size, grasps=1)


def _alike(table: Any) -> Iterator[tuple[list[tuple[str, ...]], FloatArray, FloatArray]]:
    """Yield holds of one unit and sampling together: labels, times, values (holds, times)."""
    names = ("recording", "hold_id", "channel", "unit")
    starts = _first_rows([table[name].combine_chunks() for name in names])
    labels = list(zip(*(table[name].take(starts).to_pylist() for name in names), strict=True))
    time_s, value = (table[name].to_numpy() for name in ("time_s", "value"))
    groups = defaultdict[tuple[str, bytes], list[tuple[int, slice]]](list)
    for number, (start, stop) in enumerate(pairwise([*starts, table.num_rows])):
        rows = slice(start, stop)
        groups[labels[number][-1], time_s[rows].tobytes()].append((number, rows))
    for holds in groups.values():
        together = np.stack([value[rows] for _, rows in holds])
        yield [labels[number] for number, _ in holds], time_s[holds[0][1]], together


def _first_rows(columns: Sequence[Any]) -> list[int]:
    """Return the rows in which any column differs from the row before, and the first one."""
    import pyarrow.compute

    changes = np.zeros(max(len(columns[0]) - 1, 0), dtype=bool)
    for column in columns:
        differs = pyarrow.compute.not_equal(column[1:], column[:-1])
        changes |= differs.to_numpy(zero_copy_only=False)
    return [0, *(np.flatnonzero(changes) + 1).tolist()]


def _settled_schema() -> Any:
    text = ("recording", "hold_id", "channel", "unit", "status")
    names = (
        *("recording", "hold_id", "channel", "unit", "cutoff_s"),
        *("value", "low", "high", "level", "status", "settled"),
    )
    return pa.schema([(n, pa.string() if n in text else pa.float64()) for n in names])


def _force_schema() -> Any:
    numbers = ("time_s", "force_n", "force_n_low", "force_n_high")
    return pa.schema([("recording", pa.string()), *((name, pa.float64()) for name in numbers)])


def _bin_schema() -> Any:
    text = [(name, pa.string()) for name in ("grasp_id", "item_id", "bin")]
    return pa.schema([*text, ("probability", pa.float64()), ("why", pa.string())])
