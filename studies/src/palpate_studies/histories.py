"""Force of a stretched conductive rubber from the history of its resistance, real recordings.

The resistance of the rubber peaks with strain and with its rate, in both directions, and recovers
for minutes. The models see the logarithm of the resistance and its low-passed copies, and answer in
newtons: the force crosses zero.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.errors import InputError, needing
from palpate.estimate.force_states import states_of
from palpate_studies.baselines.told_everything import boosted_trees, weighted_ridge
from palpate_studies.protocol.paired import compare
from palpate_studies.recordings import leave_out, read_runs
from palpate_studies.report import StudyReport, Table, as_command

#: From a few readings at 12 Hz to a slow cycle; longer ones learn the drift of single recordings.
_TIME_CONSTANTS_S = (0.3, 1.0, 3.0, 10.0, 30.0)
LEVEL = 0.9
_RIDGE = 1e-3
#: Smooth bumps of the kernel ridge: their number, and their width in standard deviations of an
#: input times the root of the number of inputs; the smoothest of five settings tried.
_BUMPS, _WIDTH = 120, 2.0
#: Neighbours repeat each other: every second sample is learned from.
_EVERY = 2
#: From the inputs of a recording to force and half width of its interval, where it has one.
Predictor: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray | None]]


@dataclass(frozen=True, kw_only=True, eq=False)
class History:
    """One recording.

    Attributes
    ----------
    recording_id : str
        As in the file.
    time_s, log_ohm, force_n : ndarray, shape (n_times,)
        Logarithm of the four-wire resistance, of two neighbours: the current is reversed from one
        sample to the next.
    """

    recording_id: str
    time_s: FloatArray
    log_ohm: FloatArray
    force_n: FloatArray

    @property
    def kind(self) -> str:
        """Kind of motion: the name up to its first hyphen."""
        return self.recording_id.split("-")[0]

    @cached_property
    def inputs(self) -> FloatArray:
        """What the models see, shape (n_times, n_inputs)."""
        return states_of(self.time_s, self.log_ohm, time_constants_s=_TIME_CONSTANTS_S)


def read_histories(path: Path) -> list[History]:
    """Read `recording_id,time_s,resistance_4wire_ohm,force_n`.

    Raises
    ------
    InputError
        If the file can't be used, time runs backwards, or a resistance is not above 0.
    """
    found = []
    numbers = ("time_s", "resistance_4wire_ohm", "force_n")
    for run in read_runs(path, keys=("recording_id",), text=("recording_id",), numbers=numbers):
        name, time_s, ohm = str(run["recording_id"][0]), run["time_s"], run["resistance_4wire_ohm"]
        if len(time_s) < 2 or (np.diff(time_s) < 0).any() or not (ohm > 0).all():
            raise InputError(
                f"{path}: recording {name!r}: time_s must not fall and resistance be above 0"
            )
        pairs = (ohm + np.r_[ohm[:1], ohm[:-1]]) / 2
        found.append(
            History(
                recording_id=name,
                time_s=time_s,
                log_ohm=np.log(pairs),
                force_n=run["force_n"],
            )
        )
    return found


Histories: TypeAlias = Sequence[History]


def report(
    *,
    recordings: Annotated[
        Path, typer.Option(help="Recordings of stretching to learn from.", metavar="CSV")
    ],
    test_recordings: Annotated[
        Path | None,
        typer.Option(
            help="Recordings to predict; without, kinds of motion are left out.", metavar="CSV"
        ),
    ] = None,
) -> StudyReport:
    """Predict the force of stretched silicone from its resistance, kinds of motion left out.

    Example: palpate study histories --recordings silicone_histories.csv.gz
    """
    if test_recordings is None:
        splits = leave_out(read_histories(recordings), lambda one: one.kind)
        if len(splits) < 2:
            raise InputError(f"{recordings}: one kind of motion only; two are needed")
    else:
        splits = [("", read_histories(recordings), read_histories(test_recordings))]
    rows = [
        {
            "recording_id": one.recording_id,
            "kind": one.kind,
            "model": model,
            **_scores(predict(one.inputs), one.force_n),
        }
        for _, inside, tested in splits
        for model, learn in MODELS.items()
        for predict in [learn(inside)]
        for one in tested
    ]
    by_model = {name: [row for row in rows if row["model"] == name] for name in MODELS}
    lost = {name: [row["rms_percent"] for row in mine] for name, mine in by_model.items()}
    kinds = [row["kind"] for row in by_model["ours"]]
    lead: dict[str, Any] = {"model": "{model}"}
    return StudyReport(
        name="histories",
        title="Force of stretched silicone from the history of its resistance",
        provenance=(
            "Real recordings (carbon-black silicone). "
            + (
                "Each kind of motion is predicted by models learned from the other kinds."
                if test_recordings is None
                else f"Learned from {recordings} alone."
            )
            + " Causal; no force of the tested recording is known.",
            "`ours` is a kernel ridge of this study; no command uses it.",
        ),
        tables=[
            Table.wide(
                "RMS error, percent of the range of force",
                rows,
                lead,
                over="recording_id",
                form="{rms_percent:.1f}",
            ),
            Table.wide(
                "Coverage of 90 % intervals",
                by_model["ours"],
                lead,
                over="recording_id",
                form="{coverage:.2f}",
            ),
        ],
        payload={
            "rows": rows,
            "summary": [
                {
                    "model": name,
                    "recordings": len(percent),
                    "rms_percent": float(np.mean(percent)),
                }
                for name, percent in lost.items()
            ],
            "compared": compare(lost, kinds, statistic=np.mean),
            "level": LEVEL,
        },
    )


command = as_command(report)


def _gathered(train: Histories) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return inputs, force and weight; every kind of motion counts the same."""
    kinds = [one.kind for one in train]
    weight = [
        np.full(len(one.force_n[::_EVERY]), 1.0 / len(one.force_n) / kinds.count(one.kind))
        for one in train
    ]
    pooled = np.concatenate(weight)
    return (
        np.concatenate([one.inputs[::_EVERY] for one in train]),
        np.concatenate([one.force_n[::_EVERY] for one in train]),
        pooled / pooled.mean(),
    )


def static(train: Histories) -> Predictor:
    """Learn a cubic in the reading now."""
    x, force_n, weight = _gathered(train)
    cubic = np.polyfit(x[:, 0], force_n, 3, w=np.sqrt(weight))
    return lambda x: (np.asarray(np.polyval(cubic, x[:, 0])), None)


def ridge(train: Histories) -> Predictor:
    """Learn a ridge on the same inputs."""
    answer = weighted_ridge(*_gathered(train), _RIDGE)
    return lambda x: (answer(x), None)


def trees(train: Histories) -> Predictor:
    """Learn boosted trees on the same inputs."""
    x, force_n, weight = _gathered(train)
    machine = boosted_trees(max_iter=200)
    machine.fit(x, force_n, sample_weight=weight)
    return lambda x: (np.asarray(machine.predict(x)), None)


def ours(train: Histories) -> Predictor:
    """Learn a ridge on the inputs and smooth bumps; interval from kinds of motion held out."""
    several = len({one.kind for one in train}) > 1
    splits = leave_out(train, lambda one: one.kind if several else one.recording_id)
    predict = _kernel_ridge(train)
    left = [
        np.abs(_kernel_ridge(inside)(one.inputs) - one.force_n)
        for _, inside, tested in splits
        if inside
        for one in tested
    ] or [np.abs(predict(one.inputs) - one.force_n) for one in train]
    half = float(np.quantile(np.concatenate(left), LEVEL))
    return lambda x: (predict(x), np.full(len(x), half))


def _kernel_ridge(train: Histories) -> Callable[[FloatArray], FloatArray]:
    with needing("kernel ridge", extra="produce"):
        from sklearn.kernel_approximation import Nystroem
        from sklearn.linear_model import Ridge
        from sklearn.pipeline import make_pipeline, make_union
        from sklearn.preprocessing import FunctionTransformer, StandardScaler
    x, force_n, weight = _gathered(train)
    bumps = Nystroem(
        gamma=0.5 / (_WIDTH**2 * x.shape[1]), n_components=min(_BUMPS, len(x)), random_state=0
    )
    machine = make_pipeline(
        StandardScaler(), make_union(FunctionTransformer(), bumps), Ridge(alpha=_RIDGE * len(x))
    )
    machine.fit(x, force_n, ridge__sample_weight=weight)
    return lambda x: np.asarray(machine.predict(x))


MODELS: Mapping[str, Callable[[Histories], Predictor]] = {
    "static": static,
    "ridge": ridge,
    "trees": trees,
    "ours": ours,
}


def _scores(answer: tuple[FloatArray, FloatArray | None], force_n: FloatArray) -> dict[str, Any]:
    """Return RMS errors in percent of the range of force, and the coverage of the interval."""
    value, half = answer
    error = value - force_n
    percent = 100.0 / float(np.ptp(force_n))
    return {
        "samples": len(error),
        "rms_percent": percent * float(np.sqrt(np.mean(error**2))),
        "coverage": None if half is None else float(np.mean(np.abs(error) <= half)),
    }
