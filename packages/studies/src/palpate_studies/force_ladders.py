"""Force from a sensor calibrated with three weights: real dead-weight ladders on Velostat.

Compares the paper's line, power laws, and the force law of palpate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray
from scipy.stats import t as student_t

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.calibration import ForcePairs
from palpate.errors import InputError
from palpate.force.force_law import build_settled_inputs
from palpate.force.of_calibration import HORIZON_S, fit_sheet_law
from palpate.force.sheet_states import build_settled_states
from palpate.measurement import half_width_sds
from palpate.sensor.array import ArrayLayout
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.recordings import read_runs
from palpate_studies.report import StudyReport, Table, as_command

#: Force and the limits of its interval, newtons, each of shape (n_steps,).
Predicted: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
#: Lower limit of the excess conductance under load, as a fraction of the conductance at rest.
SMALLEST_EXCESS = 0.01
Model: TypeAlias = Callable[..., Predicted]
#: Loads of a test ladder's calibration steps, newtons, spread over the working range. The first
#: weights of a ladder are near the contact threshold and carry little information.
GIVEN_N = (1.5, 4.0, 9.0)
#: Smallest number of loaded steps: the given steps and two to predict.
MIN_STEPS = 5
#: Loads up to this are not scored.
SMALLEST_LOAD_N = 0.5
#: Predicted forces are clipped to this value, so that the error of the logarithm stays finite.
FLOOR_N = 0.05
LEVEL = 0.9
FIGURES = ("median_abs_error_percent", "median_abs_log_ratio", "coverage")
Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ladder:
    """The loaded steps of one sensor, in order of time.

    Attributes
    ----------
    name : str
        Name of the sensor.
    step : ndarray of int, shape (n_steps,)
        Number of each step in the file.
    load_n, resistance_ohm : ndarray, shape (n_steps,)
        Dead weight and settled reading.
    rest_ohm : float
        Reading before the first load.
    """

    name: str
    step: NDArray[np.int_]
    load_n: FloatArray
    resistance_ohm: FloatArray
    rest_ohm: float

    @property
    def excess_s(self) -> FloatArray:
        """Excess conductance G - G0, siemens, always positive."""
        rest = 1 / self.rest_ohm
        return np.asarray(np.maximum(1 / self.resistance_ohm - rest, SMALLEST_EXCESS * rest))

    @property
    def inputs(self) -> FloatArray:
        """Settled readings as inputs of `palpate.ForceLaw`, shape (n_steps, INPUTS)."""
        return build_settled_inputs(self.excess_s * self.rest_ohm)

    @property
    def relative_percent(self) -> FloatArray:
        """Relative change of resistance (eq. 1), percent."""
        return (self.resistance_ohm / self.rest_ohm - 1) * 100


def predict_by_line(
    one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]
) -> Predicted:
    """Predict with the paper's line: slope from other ladders, intercept from the given steps."""
    value, half = _fit_shared_slope(
        [(ladder.relative_percent, ladder.load_n) for ladder in others],
        (one.relative_percent, one.load_n),
        given=given,
    )
    value, low, high = (np.maximum(each, 0.0) for each in (value, value - half, value + half))
    return value, low, high


def predict_by_power_law(
    one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]
) -> Predicted:
    """Predict with a power law: exponent from other ladders, gain from the given steps."""
    value, half = _fit_shared_slope(
        [(np.log(ladder.excess_s), np.log(ladder.load_n)) for ladder in others],
        (np.log(one.excess_s), np.log(one.load_n)),
        given=given,
    )
    return _in_newtons(value, half)


def predict_by_own_power_law(
    one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]
) -> Predicted:
    """Predict with a power law through the given steps alone, exponent and gain of this ladder."""
    log_g, log_n = np.log(one.excess_s), np.log(one.load_n)
    slope, offset = np.polyfit(log_g[given], log_n[given], 1)
    left = log_n[given] - slope * log_g[given] - offset
    freedom = left.size - 2
    x = log_g[given] - log_g[given].mean()
    spread = 1 + 1 / left.size + (log_g - log_g[given].mean()) ** 2 / float(x @ x)
    half = student_t.ppf(0.5 + LEVEL / 2, freedom) * np.sqrt(spread * (left @ left) / freedom)
    return _in_newtons(slope * log_g + offset, half)


def predict_without_weights(
    one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]
) -> Predicted:
    """Predict with one power law of all other ladders, without the given steps."""
    log_g, log_n = (
        np.concatenate([np.log(getattr(ladder, name)) for ladder in others])
        for name in ("excess_s", "load_n")
    )
    slope, offset = np.polyfit(log_g, log_n, 1)
    half = float(np.quantile(np.abs(log_n - slope * log_g - offset), LEVEL))
    return _in_newtons(slope * np.log(one.excess_s) + offset, half)


def predict_by_force_law(
    one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]
) -> Predicted:
    """Predict with `palpate.ForceLaw` from the other ladders and the given steps."""
    law = ForceLaw.fit(
        one.inputs[given],
        force_n=one.load_n[given],
        population=learn_population([make_known_contact(ladder) for ladder in others]),
    )
    value, sd = law.log_force(one.inputs)
    return _in_newtons(value, half_width_sds(LEVEL) * sd)


def predict_by_calibration(
    one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]
) -> Predicted:
    """Predict with the law that `palpate calibrate force` fits to the given steps alone."""
    excess, force_n = one.excess_s * one.rest_ohm, one.load_n[given]
    pairs = ForcePairs(
        run=tuple(range(force_n.size)),
        since_move_s=(HORIZON_S,) * force_n.size,
        excess=tuple(excess[given]),
        relative_percent=tuple(one.relative_percent[given]),
        force_n=tuple(force_n),
        pixel_excess=tuple((each,) for each in excess[given]),
    )
    layout = ArrayLayout(name=one.name, rows=1, cols=1, finger_of_row=(0,))
    law = fit_sheet_law(pairs, layout=layout)
    return law.force_n(build_settled_states(excess[:, None]), level=LEVEL)


def make_known_contact(ladder: Ladder) -> KnownContact:
    """Return a ladder as training data of a population."""
    return KnownContact(inputs=ladder.inputs, force_n=ladder.load_n, place=ladder.name)


def _in_newtons(log_n: FloatArray, half: FloatArray | float) -> Predicted:
    return np.exp(log_n), np.exp(log_n - half), np.exp(log_n + half)


def _fit_shared_slope(
    known: Sequence[tuple[FloatArray, FloatArray]],
    own: tuple[FloatArray, FloatArray],
    *,
    given: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """Fit lines with a shared slope; return this ladder's values and half widths."""
    centred = [(x - x.mean(), y - y.mean()) for x, y in known]
    squares = float(sum(x @ x for x, _ in centred))
    slope = float(sum(x @ y for x, y in centred)) / squares
    freedom = sum(len(x) for x, _ in centred) - len(centred) - 1
    variance = float(sum(np.sum((y - slope * x) ** 2) for x, y in centred)) / freedom
    x, y = own
    offset = x - x[given].mean()
    value = y[given].mean() + slope * offset
    spread = variance * (1 + 1 / np.count_nonzero(given) + offset**2 / squares)
    return value, student_t.ppf(0.5 + LEVEL / 2, freedom) * np.sqrt(spread)


MODELS: Mapping[str, Model] = {
    "line": predict_by_line,
    "power": predict_by_power_law,
    "own_power": predict_by_own_power_law,
    "pooled": predict_without_weights,
    "calibration": predict_by_calibration,
    "ours": predict_by_force_law,
}


def report(
    *,
    ladders: Annotated[Path, typer.Option(help="Training ladders of weights.", metavar="CSV")],
    test_ladders: Annotated[
        Path | None,
        typer.Option(
            help="Ladders to predict; by default each ladder in turn is held out.", metavar="CSV"
        ),
    ] = None,
) -> StudyReport:
    """Predict dead weights on real sensors, each calibrated near 1.5, 4 and 9 N.

    Example: palpate study force-ladders --ladders ladders.csv
    """
    known, rows = read_ladders(ladders), list[dict[str, Any]]()
    for one in read_ladders(test_ladders) if test_ladders else known:
        others = [ladder for ladder in known if ladder.name != one.name]
        if not others:
            raise InputError(f"{ladders}: no ladder other than {one.name!r} for training; add one")
        rows += _rows(one, others, given=_nearest(one.load_n))
    summary = [
        {"ladder": ladder, "model": model, **_scores(mine)}
        for ladder, model in dict.fromkeys((row["ladder"], row["model"]) for row in rows)
        for mine in [[row for row in rows if (row["ladder"], row["model"]) == (ladder, model)]]
    ]
    means = [
        {"model": model, **{key: float(np.mean([one[key] for one in mine])) for key in FIGURES}}
        for model in MODELS
        for mine in [[one for one in summary if one["model"] == model]]
    ]
    return StudyReport(
        name="force-ladders",
        title="Dead weights on real Velostat",
        provenance=(
            "Real recordings. Each ladder is predicted from the other ladders and from its own "
            "steps nearest to 1.5, 4 and 9 N, which are not scored.",
            f"Loads above {SMALLEST_LOAD_N} N; intervals at level {LEVEL}. "
            f"For ratios, predictions are clipped to at least {FLOOR_N} N.",
        ),
        tables=[
            Table.of(
                "New sensor calibrated with three weights, medians",
                [*summary, *({"ladder": "mean of ladders", **mean} for mean in means)],
                ("ladder", "model", *FIGURES),
            )
        ],
        payload={
            "rows": rows,
            "summary": summary,
            "means": means,
            "rest_ohm": {
                "sensors": len(known),
                "low": min(one.rest_ohm for one in known),
                "high": max(one.rest_ohm for one in known),
            },
            "level": LEVEL,
        },
    )


command = as_command(report)


def read_ladders(path: Path) -> list[Ladder]:
    """Read ladders `ladder,step,load_n,resistance_ohm`, in the order of the file.

    Raises
    ------
    InputError
        If the file can't be used, or a ladder does not start unloaded or has too few loaded steps.
    """
    found = []
    numbers = ("step", "load_n", "resistance_ohm")
    for run in read_runs(path, keys=("ladder",), text=("ladder",), numbers=numbers):
        name, (step, load_n, ohm) = str(run["ladder"][0]), (run[key] for key in numbers)
        where = f"{path}: ladder {name!r}"
        if (ohm <= 0).any() or (load_n < 0).any():
            raise InputError(
                f"{where} has a resistance of 0 ohm or less, or a load below 0 N; correct the row"
            )
        if load_n[0] != 0:
            raise InputError(f"{where} doesn't begin unloaded; add the reading at rest")
        loaded = load_n > 0
        if np.count_nonzero(loaded) < MIN_STEPS:
            raise InputError(f"{where} has fewer than {MIN_STEPS} loaded steps; record more")
        found.append(
            Ladder(
                name=name,
                step=step[loaded].astype(int),
                load_n=load_n[loaded],
                resistance_ohm=ohm[loaded],
                rest_ohm=float(ohm[0]),
            )
        )
    return found


def _nearest(load_n: FloatArray) -> NDArray[np.bool_]:
    """Return a mask of the steps nearest to the given loads, each step once."""
    given = np.zeros(len(load_n), dtype=bool)
    for at_n in GIVEN_N:
        given[np.argmin(np.where(given, np.inf, np.abs(load_n - at_n)))] = True
    return given


def _rows(one: Ladder, others: Sequence[Ladder], *, given: NDArray[np.bool_]) -> Rows:
    rows: Rows = []
    for name, predict in MODELS.items():
        value_n, low_n, high_n = predict(one, others, given=given)
        rows += [
            {
                "ladder": one.name,
                "model": name,
                "step": int(one.step[k]),
                "load_n": float(one.load_n[k]),
                "predicted_n": float(value_n[k]),
                "low_n": float(low_n[k]),
                "high_n": float(high_n[k]),
            }
            for k in np.flatnonzero((one.load_n > SMALLEST_LOAD_N) & ~given)
        ]
    return rows


def _scores(rows: Rows) -> dict[str, float]:
    load, predicted, low, high = (
        np.array([row[key] for row in rows]) for key in ("load_n", "predicted_n", "low_n", "high_n")
    )
    return {
        "median_abs_error_percent": float(np.median(np.abs(predicted / load - 1)) * 100),
        "median_abs_log_ratio": float(
            np.median(np.abs(np.log(np.maximum(predicted, FLOOR_N) / load)))
        ),
        "coverage": float(np.mean((low <= load) & (load <= high))),
    }
