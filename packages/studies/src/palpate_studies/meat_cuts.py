"""The cut of meat from real holds under an indenter, and the scatter of the measurements."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate import predict_settled
from palpate.arrays import FloatArray
from palpate.cli.output import finite_or_none
from palpate.errors import InputError
from palpate.holds import Hold, measure_settled_value, read_holds
from palpate_station.learning import make_pipeline
from palpate_station.qualify.scatter import estimate_scatter
from palpate_studies.bootstrap import bootstrap_interval
from palpate_studies.recordings import read_runs
from palpate_studies.report import Table

#: Provenance, tables and payload of a part of the report.
Part: TypeAlias = tuple[list[str], list[Table], dict[str, Any]]
#: Date, cut, number of the piece and place in an identifier such as `230331-FF12A`.
_CODE = re.compile(r"(?P<date>\d{6})-_?(?P<cut>[A-Z]+)(?P<number>\d)(?P<place>\w+)")
#: Seconds after the peak: early readings, cut-off of the prediction, and settled value.
EARLY_S, CUTOFF_S, SETTLED_S = 1.0, 2.5, 10.0
#: Forces on the ramp, below every peak: the stiffness is compared at equal force.
RAMP_N = (0.1, 0.3, 0.5)
_SHORT = ("left_1_s", "left_2.5_s", "predicted")
_LONG, _RAMP = (*_SHORT, "settled"), ("stiffness", "stiffening")
#: Inputs of the classifiers -> features, all in ln.
INPUTS = {
    "relaxation, 2.5 s": _SHORT,
    "relaxation, 10 s": _LONG,
    "ramp": _RAMP,
    "ramp and relaxation, 2.5 s": (*_RAMP, *_SHORT),
    "ramp and relaxation, 10 s": (*_RAMP, *_LONG),
}
#: Classifiers: that of `palpate sort`, and a baseline.
METHODS = ("discriminant", "logistic")


@dataclass(frozen=True, slots=True, kw_only=True)
class Squeeze:
    """One hold of meat, decoded and measured.

    Attributes
    ----------
    date, cut, piece : str
        The piece is the cut and a number; it may be tested on several dates.
    features : dict of str to float
        ln of the fractions of the peak force left, and of the stiffness in N/s and its growth.
    """

    date: str
    cut: str
    piece: str
    features: dict[str, float]

    @property
    def specimen(self) -> str:
        """One piece on one date."""
        return f"{self.date} {self.piece}"


def read_squeezes(holds: Path, tests: Path | None = None) -> list[Squeeze]:
    """Read holds, and the ramps before them.

    Raises
    ------
    InputError
        If an identifier can't be decoded, a hold is too short or not positive, or a ramp is
        missing or does not rise through `RAMP_N`.
    """
    numbers, ramps = ("time_s", "force_n"), dict[str, dict[str, float]]()
    if tests is not None:
        keys = ("recording_id",)
        for run in read_runs(tests, keys=keys, text=keys, numbers=numbers):
            name = str(run["recording_id"][0])
            ramps[name] = _measure_ramp(*(run[key] for key in numbers), where=f"{tests}: {name}")
    found = []
    for hold in read_holds(holds):
        code = _CODE.fullmatch(hold.hold_id)
        if code is None:
            raise InputError(
                f"{holds}: hold {hold.hold_id!r} doesn't name date, cut, piece and place; rename "
                "it like 230331-FF1A"
            )
        if tests is not None and hold.hold_id not in ramps:
            raise InputError(f"{tests}: no recording {hold.hold_id}; give the tests of the holds")
        features = _measure_relaxation(hold, where=f"{holds}: hold {hold.hold_id}")
        found.append(
            Squeeze(
                date=code["date"],
                cut=code["cut"],
                piece=code["cut"] + code["number"],
                features=features | ramps.get(hold.hold_id, {}),
            )
        )
    return found


def _measure_relaxation(hold: Hold, *, where: str) -> dict[str, float]:
    settled = measure_settled_value(hold.time_s, hold.values, horizon_s=SETTLED_S)
    if not (np.isfinite(settled) and (hold.values > 0).all()):
        raise InputError(f"{where} is not positive for {SETTLED_S:g} s; remove it")
    early, later = np.interp((EARLY_S, CUTOFF_S), hold.time_s, hold.values)
    predicted = predict_settled(hold, cutoff_s=CUTOFF_S, horizon_s=SETTLED_S).value
    left = dict(zip(_LONG, (early, later, float(predicted), settled), strict=True))
    return {name: math.log(value / hold.values[0]) for name, value in left.items()}


def _measure_ramp(time_s: FloatArray, force_n: FloatArray, *, where: str) -> dict[str, float]:
    """Return ln of the slope between the outer forces, and of its growth: free of the speed."""
    rising = force_n[: int(np.argmax(force_n)) + 1]
    if not rising[0] < RAMP_N[0] < RAMP_N[-1] < rising[-1]:
        raise InputError(f"{where} doesn't rise from {RAMP_N[0]:g} to {RAMP_N[-1]:g} N; remove it")
    at = []
    for force in RAMP_N:
        below = int(np.flatnonzero(rising < force)[-1])
        at.append(np.interp(force, rising[below : below + 2], time_s[below : below + 2]))
    slopes = np.diff(RAMP_N) / np.diff(at)
    slope = (RAMP_N[-1] - RAMP_N[0]) / (at[-1] - at[0])
    return dict(zip(_RAMP, (math.log(slope), math.log(slopes[1] / slopes[0])), strict=True))


def judge_cuts(squeezes: Sequence[Squeeze]) -> Part:
    """Classify the cuts with pieces and dates held out, and report the scatter.

    Raises
    ------
    InputError
        If there are not two cuts, each with two pieces and two dates.
    """
    cut, piece, date = (
        np.array([getattr(one, name) for one in squeezes]) for name in ("cut", "piece", "date")
    )
    cuts, counts = np.unique(cut, return_counts=True)
    if len(cuts) < 2 or any(
        len(set(names[cut == one])) < 2 for one in cuts for names in (piece, date)
    ):
        raise InputError("the holds must be of two cuts, each with two pieces and two dates")
    # With one piece held out at a time, the cut of that piece would be rarer among the others.
    pieces = product(*(sorted(set(piece[cut == one])) for one in cuts))
    splits = {
        "a piece of each cut": [np.isin(piece, held) for held in pieces],
        "a date": [date == held for held in sorted(set(date))],
    }
    specimens = [one.specimen for one in squeezes]
    rows, scatter = list[dict[str, Any]](), list[dict[str, Any]]()
    for split, held_out in splits.items():
        for inputs, names in INPUTS.items():
            if not set(names) <= set(squeezes[0].features):
                continue
            table = np.array([[one.features[name] for name in names] for one in squeezes])
            row = {"inputs": inputs, "held_out": split, "constant": max(counts) / len(cut)}
            for method in METHODS:
                right = _classify(table, cut, held_out, method=method)
                row[method] = float(right.mean())
                row[f"{method}_interval"] = bootstrap_interval(right, specimens, statistic=np.mean)
            rows.append(row)
    for name in ("settled", "stiffness"):
        if name in squeezes[0].features:
            scatter.append({"ln_of": name} | _measure_scatter(squeezes, name))
    accuracy = {
        method: f"{{{method}:.2f}} ({{{method}_interval[0]:.2f}} to {{{method}_interval[1]:.2f}})"
        for method in METHODS
    }
    provenance = [
        f"Real: {len(cut)} holds of raw meat under one indenter, {len(set(piece))} pieces of "
        f"{len(cuts)} cuts ({', '.join(cuts)}; the kind is inferred from codes), "
        f"{len(set(date))} dates. 90 % intervals over {len(set(specimens))} specimens (a piece on "
        "a date). Ramps to different forces, perhaps at different speeds, differ between dates.",
        "For a buyer: a squeeze tells the cut only where the interval is above the constant, the "
        "fraction of the most frequent cut. It says nothing here about tenderness, age or origin, "
        "which were not recorded; with so few pieces a cut can't be told from an animal.",
    ]
    head = {"inputs": "{inputs}", "held out": "{held_out}", "constant": "{constant:.2f}"}
    tables = [
        Table.of("Fraction of holds whose cut is correct", rows, head | accuracy),
        Table.of("Scatter (sd of ln), and largest difference between cuts", scatter),
    ]
    return provenance, tables, {"holds": len(cut), "cuts": rows, "scatter": scatter}


def _classify(
    table: FloatArray, cut: NDArray[np.str_], held_out: Sequence[NDArray[np.bool_]], *, method: str
) -> FloatArray:
    """Return the fraction of correct answers for each hold, over the splits that hold it out."""
    right, times = np.zeros(len(cut)), np.zeros(len(cut))
    for held in held_out:
        model = make_pipeline(method).fit(table[~held], cut[~held])
        right[held] += model.predict(table[held]) == cut[held]
        times[held] += 1
    return right / times


def _measure_scatter(squeezes: Sequence[Squeeze], name: str) -> dict[str, float | None]:
    """Return the standard deviations between places, specimens of a cut and date, and dates.

    None where nothing was repeated.
    """
    values = np.array([one.features[name] for one in squeezes])
    _, first, specimen = np.unique(
        [one.specimen for one in squeezes], return_index=True, return_inverse=True
    )
    places = estimate_scatter(values, specimen).within
    count = np.bincount(specimen)
    mean = np.bincount(specimen, weights=values) / count
    kinds = [(squeezes[row].cut, squeezes[row].date) for row in first]
    cut, date = (np.unique(part, return_inverse=True)[1] for part in zip(*kinds, strict=True))
    cut_mean = np.bincount(cut, weights=mean) / np.bincount(cut)
    # Specimens of one cut and date; their means also scatter because places do.
    of_means = estimate_scatter(mean, cut * (max(date) + 1) + date).within
    found = {
        "places": places,
        "specimens": math.sqrt(max(of_means**2 - places**2 * float(np.mean(1 / count)), 0.0)),
        "dates": estimate_scatter(mean - cut_mean[cut], date).between,
        "between_cuts": float(np.ptp(cut_mean)),
    }
    return {key: finite_or_none(value) for key, value in found.items()}
