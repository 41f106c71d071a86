"""Force of a published soft sensor from its voltage: depths that were not seen in training.

Han, Lee and others, IEEE RA-L 3(2), 2018: a microfluidic sensor, strokes at three places, down and
up, force from a load cell. A stroke knows its own past only; place, depth and speed are labels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.errors import InputError, needing
from palpate.estimate.force_states import states_of
from palpate.tables import read_table
from palpate_studies.force_model import ForceModel
from palpate_studies.report import OutOption, StudyReport, Table

#: In samples: the recordings have no clock (about 22 Hz).
TIME_CONSTANTS = (1.0, 2.0, 4.0, 8.0, 16.0)
LAGS = (1, 2, 3, 4, 6)
#: Taken off before the logarithm: below the smallest voltage, about that without pressure.
ZERO_V, LEAST_V = 0.03, 0.002
#: The law bends more sharply than that of a sheet, and there are many strokes.
LANDMARKS = 400
RIDGE = 1e-3
LEVEL = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """One stroke: inputs of shape (n, n_inputs), voltage and force of shape (n,), labels."""

    stroke_id: str
    inputs: FloatArray
    voltage_v: FloatArray
    force_n: FloatArray
    depth_rank: int

    @property
    def unloading(self) -> NDArray[np.bool_]:
        """Samples after the largest force."""
        return np.arange(len(self.force_n)) > int(np.argmax(self.force_n))


def command(
    train: Annotated[Path, typer.Option(help="Strokes to learn from.", metavar="CSV")],
    test: Annotated[
        Path | None,
        typer.Option(help="Strokes to predict; without, each depth in turn.", metavar="CSV"),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Predict the force of a soft sensor from its voltage alone.

    Example: palpate study soft-sensor --train soft_sensor_ral2018.csv.gz
    """
    known = read_strokes(train)
    if test is not None:
        splits = {"test": (known, read_strokes(test))}
    else:
        splits = {
            _DEPTHS.get(rank, f"depth {rank}"): (
                [one for one in known if one.depth_rank != rank],
                [one for one in known if one.depth_rank == rank],
            )
            for rank in sorted({one.depth_rank for one in known})
        }
        if len(splits) < 2:
            raise InputError(f"{train}: one depth only; leave-one-out needs two, or give --test")
    summary = [
        {"split": split, "model": name, **_scores(learn(inside), tested)}
        for split, (inside, tested) in splits.items()
        for name, learn in MODELS.items()
    ]
    _report(summary, strokes=len(known)).emit(as_json=as_json, out=out)


_DEPTHS = {0: "shallowest left out", 1: "middle depth left out", 2: "deepest left out"}


def read_strokes(path: Path) -> list[Stroke]:
    """Read `stroke_id,sample,location_mm,depth_mm,voltage_v,force_n`.

    Raises
    ------
    InputError
        If the file can't be used.
    """
    table = read_table(
        path,
        columns={
            "stroke_id": "text",
            "location_mm": "number",
            "depth_mm": "number",
            "voltage_v": "number",
            "force_n": "number",
        },
    )
    ids = table["stroke_id"]
    if not len(ids):
        raise InputError(f"{path}: no stroke in it")
    edges = [0, *(np.flatnonzero(ids[1:] != ids[:-1]) + 1).tolist(), len(ids)]
    ranks = {
        place: np.unique(table["depth_mm"][table["location_mm"] == place])
        for place in np.unique(table["location_mm"])
    }
    strokes = []
    for start, end in pairwise(edges):
        voltage_v = table["voltage_v"][start:end]
        depths = ranks[table["location_mm"][start]]
        strokes.append(
            Stroke(
                stroke_id=str(ids[start]),
                inputs=_inputs(voltage_v),
                voltage_v=voltage_v,
                force_n=table["force_n"][start:end],
                depth_rank=int(np.searchsorted(depths, table["depth_mm"][start])),
            )
        )
    return strokes


def _inputs(voltage_v: FloatArray) -> FloatArray:
    """Return what a stroke has shown until each sample: states, steps, its start, fastest rise."""
    reading = np.log(np.maximum(voltage_v - ZERO_V, LEAST_V))
    count = len(reading)
    states = states_of(np.arange(count), reading, time_constants_s=TIME_CONSTANTS)
    padded = np.concatenate([np.full(max(LAGS), reading[0]), reading])
    steps = [reading - padded[max(LAGS) - lag : max(LAGS) - lag + count] for lag in LAGS]
    rise = np.maximum.accumulate(np.diff(reading, prepend=reading[0]))
    return np.column_stack([states, *steps, np.full(count, reading[0]), rise])


Predictor: TypeAlias = Callable[[Stroke], tuple[FloatArray, FloatArray | None]]


def _gathered(strokes: Sequence[Stroke]) -> tuple[FloatArray, FloatArray]:
    return (
        np.concatenate([one.inputs for one in strokes]),
        np.concatenate([one.force_n for one in strokes]),
    )


def constant(train: Sequence[Stroke]) -> Predictor:
    """Learn the mean force."""
    mean_n = float(np.mean(_gathered(train)[1]))
    return lambda one: (np.full(len(one.force_n), mean_n), None)


def static(train: Sequence[Stroke]) -> Predictor:
    """Learn a cubic in the voltage now."""
    voltage = np.concatenate([one.voltage_v for one in train])
    cubic = np.polyfit(voltage, _gathered(train)[1], 3)

    def predict(one: Stroke) -> tuple[FloatArray, None]:
        value: FloatArray = np.asarray(np.polyval(cubic, one.voltage_v), dtype=float)
        return value, None

    return predict


def ridge(train: Sequence[Stroke]) -> Predictor:
    """Learn a ridge on the same inputs."""
    x, y = _gathered(train)
    centre, scale = x.mean(axis=0), x.std(axis=0)
    z = (x - centre) / scale
    weights = np.linalg.solve(z.T @ z / len(z) + RIDGE * np.eye(z.shape[1]), z.T @ y / len(z))
    mean_n = float(y.mean())
    return lambda one: (np.asarray(mean_n + (one.inputs - centre) / scale @ weights), None)


def trees(train: Sequence[Stroke]) -> Predictor:
    """Learn boosted trees on the same inputs."""
    with needing("gradient boosting", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingRegressor
    x, y = _gathered(train)
    machine = HistGradientBoostingRegressor(max_iter=200, random_state=0).fit(x, y)
    return lambda one: (machine.predict(one.inputs), None)


def ours(train: Sequence[Stroke]) -> Predictor:
    """Learn the force model: settings by strokes left out, interval widths by depths left out."""
    model = _fitted(train)
    depths = sorted({one.depth_rank for one in train})
    if len(depths) > 1:
        inputs, errors = [], []
        for depth in depths:
            partial = _fitted([one for one in train if one.depth_rank != depth])
            x, y = _gathered([one for one in train if one.depth_rank == depth])
            inputs.append(x)
            errors.append(partial.predict(x)[0] - y)
        model = model.with_errors(np.concatenate(inputs), errors=np.concatenate(errors))
    return lambda one: model.predict(one.inputs, level=LEVEL)


def _fitted(strokes: Sequence[Stroke]) -> ForceModel:
    x, y = _gathered(strokes)
    group = [one.stroke_id for one in strokes for _ in one.force_n]
    return ForceModel.fit(x, target=y, group=group, robust=False, landmarks=LANDMARKS)


MODELS: Mapping[str, Callable[[Sequence[Stroke]], Predictor]] = {
    "constant": constant,
    "static": static,
    "ridge": ridge,
    "trees": trees,
    "ours": ours,
}


def _scores(predict: Predictor, tested: Sequence[Stroke]) -> dict[str, Any]:
    answers = [predict(one) for one in tested]
    error = np.concatenate([a[0] - one.force_n for a, one in zip(answers, tested, strict=True)])
    unloading = np.concatenate([one.unloading for one in tested])
    half = [answer[1] for answer in answers if answer[1] is not None]
    covered = np.abs(error) <= np.concatenate(half) if half else None
    return {
        "samples": len(error),
        "rms_n": _rms(error),
        "rms_n_loading": _rms(error[~unloading]),
        "rms_n_unloading": _rms(error[unloading]),
        "coverage": None if covered is None else float(np.mean(covered)),
    }


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2))) if len(error) else 0.0


def _report(summary: list[dict[str, Any]], *, strokes: int) -> StudyReport:
    columns = ("rms_n", "rms_n_loading", "rms_n_unloading")
    return StudyReport(
        name="soft-sensor",
        title="Force of a published soft sensor from its voltage",
        provenance=(
            "Real recordings (Han et al., RA-L 3(2), 2018). A stroke sees its own past voltages; "
            f"place, depth and speed are not given. Learned from {strokes} strokes of the training "
            "file; without --test each of its three depths is left out in turn.",
        ),
        tables=[
            Table(
                title="RMS error, N",
                columns=("split", "model", "all", "loading", "unloading", "coverage (0.9)"),
                rows=[
                    [
                        one["split"],
                        one["model"],
                        *(f"{one[key]:.2f}" for key in columns),
                        "" if one["coverage"] is None else f"{one['coverage']:.2f}",
                    ]
                    for one in summary
                ],
            )
        ],
        payload={"summary": summary, "level": LEVEL},
    )
