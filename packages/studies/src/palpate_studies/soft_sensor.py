"""Force of a microfluidic soft sensor from its voltage, with held-out press depths.

Han et al., IEEE RA-L 3(2), 2018: strokes down and up at three places, with a load cell. The inputs
of a method are the past voltages of the stroke; place, depth and speed are not inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.force.force_states import compute_states, log_reading
from palpate.measurement import half_width_sds
from palpate_studies.baselines.full_input_learners import make_ridge, make_trees
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.recordings import leave_out, read_runs
from palpate_studies.report import StudyReport, Table, as_command

LEVEL = 0.9
#: The recordings have no clock; according to their description the rate is about 22 Hz.
_PERIOD_S = 1 / 22
#: Voltage without pressure, below the smallest of the training set, volt.
_REST_V = 0.03
#: Excess at the 90th percentile of the training set after scaling, typical of Velostat.
_USUAL_EXCESS = 10.0
#: Lags of the voltages in the inputs of ridge and trees, samples.
_LAGS = (0, 1, 2, 3, 4, 6, 10)
#: Weakest training force of the law, newtons: the threshold of the other studies.
_LEAST_N = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """One stroke: labels, voltage and force of shape (n,)."""

    place_mm: float
    depth_mm: float
    voltage_v: FloatArray
    force_n: FloatArray

    @property
    def unloading(self) -> NDArray[np.bool_]:
        """Samples after the largest force."""
        return np.arange(len(self.force_n)) > int(np.argmax(self.force_n))

    def inputs(self, volt: float = 0.1) -> FloatArray:
        """Return the inputs of the force law, shape (n, INPUTS).

        `volt`: voltage above rest that is scaled to an excess of 10.
        """
        excess = _USUAL_EXCESS * (self.voltage_v - _REST_V) / volt
        return compute_states(_PERIOD_S * np.arange(len(excess)), log_reading(excess))

    def past(self) -> FloatArray:
        """Return the inputs, the lagged voltages, and the first voltage."""
        padded = np.concatenate([np.full(max(_LAGS), self.voltage_v[0]), self.voltage_v])
        late = [padded[max(_LAGS) - lag : len(padded) - lag] for lag in _LAGS]
        return np.column_stack([self.inputs(), *late, np.full(len(late[0]), self.voltage_v[0])])


Strokes: TypeAlias = Sequence[Stroke]
#: From a stroke to its force and the limits of the interval, None without an interval.
Predictor: TypeAlias = Callable[[Stroke], tuple[FloatArray, tuple[FloatArray, FloatArray] | None]]


def report(
    *,
    train: Annotated[Path, typer.Option(help="Training strokes.", metavar="CSV")],
    test: Annotated[
        Path | None,
        typer.Option(
            help="Strokes to predict; by default each depth in turn is held out.", metavar="CSV"
        ),
    ] = None,
) -> StudyReport:
    """Predict the force of a soft sensor from its voltage at held-out depths.

    Example: palpate study soft-sensor --train soft_sensor_ral2018.csv.gz
    """
    known = read_strokes(train)
    splits = [("test", known, read_strokes(test))] if test is not None else _split_by_depth(known)
    if test is None and len(splits) < 2:
        raise InputError(f"{train}: one depth only; two are needed, or --test")
    summary = [
        {"split": split, "model": name, **_scores(learn(inside), tested)}
        for split, inside, tested in splits
        for name, learn in MODELS.items()
    ]
    return StudyReport(
        name="soft-sensor",
        title="Force of a microfluidic soft sensor from its voltage",
        provenance=(
            f"Real recordings (Han et al., RA-L 3(2), 2018), {len(known)} training strokes. The "
            "inputs are the past voltages of a stroke; place, depth and speed are not given.",
            "`palpate` is `palpate.ForceLaw` on the voltage above rest, scaled with the training "
            "set.",
        ),
        tables=[Table.of("RMS error", summary)],
        payload={"origin": "real", "summary": summary, "level": LEVEL},
    )


command = as_command(report)


def read_strokes(path: Path) -> list[Stroke]:
    """Read strokes `stroke_id,location_mm,depth_mm,voltage_v,force_n`.

    Consecutive rows with one id are a stroke. Raises `InputError` if the file can't be used or is
    empty.
    """
    names = ("location_mm", "depth_mm", "voltage_v", "force_n")
    return [
        Stroke(
            place_mm=float(run["location_mm"][0]),
            depth_mm=float(run["depth_mm"][0]),
            voltage_v=run["voltage_v"],
            force_n=run["force_n"],
        )
        for run in read_runs(path, keys=("stroke_id",), text=("stroke_id",), numbers=names)
    ]


def _split_by_depth(known: Strokes) -> list[tuple[str, Strokes, Strokes]]:
    """Hold out each depth in turn, by its rank at each place, from the shallowest."""
    depths: dict[float, set[float]] = {}
    for one in known:
        depths.setdefault(one.place_mm, set()).add(one.depth_mm)
    splits = leave_out(known, lambda one: sorted(depths[one.place_mm]).index(one.depth_mm))
    splits.sort(key=lambda split: split[0])
    return [(f"depth {rank + 1} left out", train, tested) for rank, train, tested in splits]


def _forces(strokes: Strokes) -> FloatArray:
    return np.concatenate([one.force_n for one in strokes])


def learn_constant(train: Strokes) -> Predictor:
    """Learn the mean force."""
    mean_n = float(_forces(train).mean())
    return lambda one: (np.full(len(one.force_n), mean_n), None)


def learn_cubic(train: Strokes) -> Predictor:
    """Learn a cubic in the current voltage."""
    cubic = np.polyfit(np.concatenate([one.voltage_v for one in train]), _forces(train), 3)
    return lambda one: (np.asarray(np.polyval(cubic, one.voltage_v)), None)


def learn_ridge(train: Strokes) -> Predictor:
    """Learn a ridge on the inputs of the force law and past voltages."""
    return _fit_machine(train, make_ridge(1.0))


def learn_trees(train: Strokes) -> Predictor:
    """Learn boosted trees on the inputs of the force law and past voltages."""
    return _fit_machine(train, make_trees())


def _fit_machine(train: Strokes, machine: Any) -> Predictor:
    machine.fit(np.concatenate([one.past() for one in train]), _forces(train))
    return lambda one: (np.asarray(machine.predict(one.past())), None)


def learn_force_law(train: Strokes) -> Predictor:
    """Learn the population of `palpate.ForceLaw`."""
    volt = float(np.percentile(np.concatenate([one.voltage_v for one in train]) - _REST_V, 90))
    contacts = [
        KnownContact(
            inputs=one.inputs(volt)[used],
            force_n=one.force_n[used],
            place=one.place_mm,
        )
        for one in train
        for used in [one.force_n >= _LEAST_N]
    ]
    law, quantile = ForceLaw(learn_population(contacts)), half_width_sds(LEVEL)

    def predict(one: Stroke) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
        log_n, sd = law.log_force(one.inputs(volt))
        return np.exp(log_n), (np.exp(log_n - quantile * sd), np.exp(log_n + quantile * sd))

    return predict


MODELS: Mapping[str, Callable[[Strokes], Predictor]] = {
    "constant": learn_constant,
    "static": learn_cubic,
    "ridge": learn_ridge,
    "trees": learn_trees,
    "ours": learn_force_law,
}


def _scores(predict: Predictor, tested: Strokes) -> dict[str, Any]:
    answers = [predict(one) for one in tested]
    truth, unloading = _forces(tested), np.concatenate([one.unloading for one in tested])
    error = np.concatenate([value for value, _ in answers]) - truth
    ends = [interval for _, interval in answers if interval is not None]
    covers = None
    if ends:
        low, high = (np.concatenate(each) for each in zip(*ends, strict=True))
        covers = (low <= truth) & (truth <= high)
    return {
        "samples": len(error),
        "rms_n": _rms(error),
        "rms_n_loading": _rms(error[~unloading]),
        "rms_n_unloading": _rms(error[unloading]),
        "coverage": None if covers is None else float(np.mean(covers)),
    }


def _rms(error: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(error**2))) if len(error) else None
