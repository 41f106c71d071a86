"""How well any predictor could do: learners trained on the same specimens, and Bayes' answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.errors import InputError, needing
from palpate.holds import Hold, read_holds
from palpate.settling.predict import METHODS, predict_settled
from palpate.settling.scoring import settled_value
from palpate.signal.transient import peak_index
from palpate_studies.report import OutOption, StudyReport, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CUTOFFS_S = (1.0, 2.5, 5.0)
HORIZON_S = 20.0
#: Stretches of log time that a learner sees of a hold, and parts that take turns at being tested.
STRETCHES, FOLDS = 6, 10
#: Settled values lie in the middle of the last half second.
TARGET_S = 19.75
#: Holds drawn of the family that meets Table 1: for the Bayes estimator to weigh, and to test on.
DRAWN, TESTED = 20_000, 300
#: Noise of the mean of 8 pixels, quantised, % of the rest value; settled changes of three sheets.
NOISE_PERCENT, SETTLED_PERCENT = 0.05, (-72.0, -46.0)
RATE_HZ = 15.0


def command(
    holds: Annotated[Path | None, typer.Option(help="Real holds.", metavar="FILE")] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Show what limits a prediction. Example: palpate study settling-limits --holds FILE."""
    if holds is None:
        raise InputError("name a recording with --holds FILE")
    report(holds).emit(as_json=as_json, out=out)


def report(file: Path) -> StudyReport:
    """Put the learners on real holds and the Bayes estimator on drawn ones into one report."""
    known = [
        hold
        for hold in read_holds(file, until_s=HORIZON_S)
        if np.isfinite(settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S))
    ]
    if len(known) < 2 * FOLDS:
        raise InputError(f"{file}: {len(known)} holds reach {HORIZON_S:g} s; learners need 20")
    real = {
        "log_law_early": _errors(known, method="log_law_early"),
        **_learners(known),
        "relaxation": _errors(known, method="relaxation"),
    }
    drawn = drawn_family()
    return StudyReport(
        name="settling-limits",
        title="What limits the prediction of a settled value",
        provenance=(
            f"Real recordings: {file.name}, {len(known)} holds. Learners are tested on tenths of "
            "the holds that they were not trained on, but know the specimens. The odds of "
            "relaxation were learned on recordings of this kind, where they are public "
            "on these very holds.",
            f"Drawn from a formula (not a sensor): {TESTED} holds of the family that meets the "
            "recorded row of Table 1. The Bayes estimator knows the family; to relaxation it is "
            "one of several.",
        ),
        tables=[
            _table("Real: median |error|, % of the settled value (90th percentile)", real, _median),
            _table("Drawn: mean |error|, % of the settled value", drawn, _mean),
        ],
        figures={"settling-limits": lambda: _figure(real, drawn)},
        payload={
            "real_median_percent": _payload(real, np.median),
            "drawn_mean_percent": _payload(drawn, np.mean),
        },
    )


def _errors(holds: Sequence[Hold], *, method: str) -> list[FloatArray]:
    """Return |error| in % of each hold, at each cut-off."""
    return [
        np.array([_percent(hold, cutoff_s, method=method) for hold in holds])
        for cutoff_s in CUTOFFS_S
    ]


def _percent(hold: Hold, cutoff_s: float, *, method: str) -> float:
    settled = settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S)
    found = predict_settled(hold.time_s, hold.values, cutoff_s=cutoff_s, method=method)
    return 100 * abs(float(found.value) / settled - 1)


def _since_peak(hold: Hold, cutoff_s: float) -> tuple[FloatArray, FloatArray]:
    seen = hold.time_s <= cutoff_s
    time_s, values = hold.time_s[seen], hold.values[seen]
    peak = int(peak_index(values[None])[0])
    return time_s[peak:] - time_s[peak], values[peak:]


def _learners(holds: Sequence[Hold]) -> dict[str, list[FloatArray]]:
    """Return the errors of learners, blind to the unit and given the ohm value."""
    with needing("settling-limits", extra="produce"):
        from sklearn.ensemble import ExtraTreesRegressor
        from sklearn.linear_model import RidgeCV
    kinds: dict[str, Callable[[], Any]] = {
        "ridge": lambda: RidgeCV(np.geomspace(1e-4, 10, 12)),
        "extra trees": lambda: ExtraTreesRegressor(100, min_samples_leaf=3, random_state=0),
    }
    return {
        f"{name}, same specimens{', given the ohm value' if given_ohm else ''}": [
            _cross_validated(holds, make, cutoff_s=cutoff_s, given_ohm=given_ohm)
            for cutoff_s in CUTOFFS_S
        ]
        for name, make in kinds.items()
        for given_ohm in (False, True)
    }


def _cross_validated(
    holds: Sequence[Hold], make: Callable[[], Any], *, cutoff_s: float, given_ohm: bool
) -> FloatArray:
    """Return |error| in % of each hold, predicted by a learner trained on the other folds."""
    rows = [_stretches(hold, cutoff_s) for hold in holds]
    last = np.array([row[-1] for row in rows])
    fallen = np.array([row[:-1] - row[-1] for row in rows])
    drop = np.abs(fallen).max(axis=1)
    settled = np.array(
        [settled_value(h.time_s, h.values, horizon_s=HORIZON_S) for h in holds], dtype=np.float64
    )
    features = fallen / drop[:, None]
    if given_ohm:
        features = np.column_stack([features, np.log(drop / np.abs(last))])
    target, weight = (settled - last) / drop, (drop / np.abs(settled)) ** 2
    predicted = np.empty(len(holds))
    fold = np.arange(len(holds)) % FOLDS
    for part in range(FOLDS):
        train = fold != part
        learner = make().fit(features[train], target[train], sample_weight=weight[train])
        predicted[~train] = learner.predict(features[~train])
    return np.asarray(100 * np.abs(predicted - target) * drop / np.abs(settled))


def _stretches(hold: Hold, cutoff_s: float) -> FloatArray:
    """Return the hold's value in stretches of log time, the first from the peak on."""
    since_s, values = _since_peak(hold, cutoff_s)
    edges = np.geomspace(0.1, cutoff_s + 0.1, STRETCHES + 1) - 0.1
    middle = np.interp((edges[1:] + edges[:-1]) / 2, since_s, values)
    for index, (start_s, end_s) in enumerate(pairwise(edges)):
        inside = (since_s >= start_s) & (since_s <= end_s)
        if inside.sum() > 1:
            middle[index] = values[inside].mean()
    return np.asarray(middle)


def drawn_family(*, seed: int = 5) -> dict[str, list[FloatArray]]:
    """Return |error| in % on holds drawn of the family that meets Table 1's recorded row.

    The Bayes estimator weighs holds drawn of the same family by how well each explains the samples,
    once with the zero of the relative change known and once with differences alone, as `relaxation`
    sees them. No predictor that knows less can have a smaller mean error than it by much.
    """
    rng = np.random.default_rng(seed)
    found: dict[str, list[FloatArray]] = {
        "Bayes, family and zero known": [],
        "Bayes, family known": [],
        **{name: [] for name in METHODS},
    }
    for cutoff_s in CUTOFFS_S:
        since_s = np.arange(0.0, cutoff_s - 0.2, 1 / RATE_HZ)
        guesses, truths = (_family(rng, n, np.append(since_s, TARGET_S)) for n in (DRAWN, TESTED))
        settled = rng.uniform(*SETTLED_PERCENT, TESTED)[:, None]
        seen = settled * truths[:, :-1] + rng.normal(0.0, NOISE_PERCENT, (TESTED, since_s.size))
        value = settled[:, 0]
        for name, centred in (("family and zero known", False), ("family known", True)):
            predicted = np.array([_weighed(row, guesses, centred=centred) for row in seen])
            found[f"Bayes, {name}"].append(100 * np.abs(predicted / value - 1))
        for name in METHODS:
            estimate = predict_settled(since_s, seen, cutoff_s=cutoff_s, method=name)
            found[name].append(np.asarray(100 * np.abs(estimate.value / value - 1)))
    return found


def _family(rng: np.random.Generator, n: int, since_s: FloatArray) -> FloatArray:
    """Draw holds as shares of their settled value, shape (n, n_times); the last is the settled."""
    middle = 0.131 * np.exp(0.28 * rng.normal(size=n))
    middle_s = 1.96 * np.exp(0.37 * rng.normal(size=n))
    slow, log_rate = 0.068 + 0.026 * rng.normal(size=n), 0.0103 + 0.0089 * rng.normal(size=n)
    left = (
        0.37 * np.exp(-since_s / 0.086)
        + middle[:, None] * np.exp(-((since_s / middle_s[:, None]) ** 1.12))
        + slow[:, None] * np.exp(-since_s / 17.2)
        - log_rate[:, None] * np.log1p(since_s / 3.2)
    )
    return np.asarray(1 - (left - left[:, -1:]))


def _weighed(samples: FloatArray, guesses: FloatArray, *, centred: bool) -> float:
    """Return the posterior mean of the settled value, the scale of each guess fitted to it."""
    shapes, end = guesses[:, :-1], guesses[:, -1]
    level = samples.mean() if centred else 0.0
    middle = shapes.mean(axis=1) if centred else np.zeros(len(shapes))
    shapes = shapes - middle[:, None]
    power = (shapes**2).sum(axis=1)
    scale = shapes @ (samples - level) / power
    misfit = ((samples - level) ** 2).sum() - scale**2 * power
    # Few of the guesses are close in all four parameters: the likelihood is flattened a little.
    weight = np.exp(-(misfit - misfit.min()) / (8 * NOISE_PERCENT**2))
    return float(weight @ (level + scale * (end - middle)) / weight.sum())


def _median(errors: FloatArray) -> str:
    return f"{np.median(errors):.2f} ({np.percentile(errors, 90):.1f})"


def _mean(errors: FloatArray) -> str:
    return f"{errors.mean():.2f}"


def _table(
    title: str, rows: Mapping[str, list[FloatArray]], cell: Callable[[FloatArray], str]
) -> Table:
    return Table(
        title=title,
        columns=("predictor", *(f"{cutoff_s:g} s" for cutoff_s in CUTOFFS_S)),
        rows=[(name, *map(cell, errors)) for name, errors in rows.items()],
    )


def _figure(real: Mapping[str, list[FloatArray]], drawn: Mapping[str, list[FloatArray]]) -> Figure:
    from palpate.plots.style import SPARE_LOOKS, legend_below, log_axis, look_of, new_figure

    with new_figure(columns=2, width_in=7.0, height_in=4.4) as (figure, axes):
        for axis, rows, of, title in (
            (axes[0, 0], real, np.median, "real holds: median |error|"),
            (axes[0, 1], drawn, np.mean, "drawn from a formula: mean |error|"),
        ):
            for index, (name, errors) in enumerate(rows.items()):
                colour, marker = look_of(name) if name in METHODS else SPARE_LOOKS[index % 3]
                line = "-" if name in METHODS else "--" if index < len(SPARE_LOOKS) else ":"
                values = [of(error) for error in errors]
                axis.plot(CUTOFFS_S, values, line, color=colour, marker=marker, label=name)
            axis.set(
                xlabel="cut-off (s)",
                ylabel="error (% of the settled value)",
                title=title,
                xticks=CUTOFFS_S,
            )
            log_axis(axis.yaxis)
        legend_below(figure, axes, entry_in=3.4)
    return figure


def _payload(
    rows: Mapping[str, list[FloatArray]], of: Callable[[FloatArray], Any]
) -> dict[str, list[float]]:
    return {name: [float(of(errors)) for errors in columns] for name, columns in rows.items()}
