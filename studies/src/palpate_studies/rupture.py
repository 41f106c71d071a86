"""When to stop closing on a fruit: our guard beside a cap per fruit and a linear stiffness rule."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
import typer

from palpate.errors import InputError
from palpate.estimate.damage import FOLDS, NOMINAL_RATE, DamageModel, half_load
from palpate.estimate.damage_learning import learn, split
from palpate.estimate.fruit_closings import FruitClosing, read_closings
from palpate_studies import rupture_told
from palpate_studies.report import JsonOption, OutOption, StudyReport, Table
from palpate_studies.rupture_policies import (
    Scored,
    cap_scores,
    fit_rule,
    our_scores,
    rule_scores,
    stop_forces,
)
from palpate_studies.rupture_published import PUBLISHED, published_scores
from palpate_studies.rupture_tradeoff import RATES, Method, tradeoff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pairs of closings that are learned from and closings that are judged.
_Splits: TypeAlias = Sequence[tuple[list[FruitClosing], list[FruitClosing]]]


def command(
    curves: Annotated[Path, typer.Option(help="Closings to learn from.", metavar="CSV")],
    index: Annotated[Path, typer.Option(help="Their rupture forces.", metavar="CSV")],
    test_curves: Annotated[
        Path | None, typer.Option(help="Closings to test on; without, 5 folds.", metavar="CSV")
    ] = None,
    test_index: Annotated[
        Path | None, typer.Option(help="Their rupture forces.", metavar="CSV")
    ] = None,
    nominal_rate: Annotated[
        float, typer.Option(help="Share of fruit that the guard may let rupture.")
    ] = NOMINAL_RATE,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Predict where real fruit ruptures while closing on it, and stop before.

    Example: palpate study rupture --curves fruit.csv.gz --index fruit_index.csv
    """
    if (test_curves is None) != (test_index is None):
        raise InputError("--test-curves and --test-index go together; give both or neither")
    if not 0 < nominal_rate < 1:
        raise InputError(f"--nominal-rate {nominal_rate}: it must lie between 0 and 1")
    closings = read_closings(curves, index)
    if test_curves is None or test_index is None:
        splits = split(closings)
        how = f"{FOLDS}-fold cross-validation"
    else:
        splits = [(closings, read_closings(test_curves, test_index))]
        how = f"learned from {index}, tested on {test_index}"
    _report(splits, how=how, nominal_rate=nominal_rate).emit(as_json=as_json, out=out)


def _report(splits: _Splits, *, how: str, nominal_rate: float) -> StudyReport:
    rows, ours = _guarded(splits, known=True, nominal_rate=nominal_rate)
    rows_unknown, ours_unknown = _guarded(splits, known=False, nominal_rate=nominal_rate)
    tested = [closing for _, test in splits for closing in test]
    scores = {"ours": ours, "ours, fruit unknown": ours_unknown, **_baseline_scores(splits)}
    if all(closing.fruit in PUBLISHED for closing in tested):
        scores["rule as published"] = [published_scores(closing) for closing in tested]
    entries = tradeoff([Method(name, scores[name]) for name in scores], closings=tested)
    told = rupture_told.told_half_load(splits)
    provenance = (
        f"Real recordings of fruit closed on until rupture; {how}.",
        f"Guard at a nominal rupture rate of {nominal_rate:.1%}; every sample used precedes the "
        "decision.",
        "Trade-off: every method swept over its setting on the tested fruit, alike. Stiffness "
        "rule: a line per fruit fitted to the training fruit, with our stiffness. Rule as "
        "published: with its authors' constants and window; they fitted them to fruit that may be "
        "among these.",
        "What learners that are told everything do on such fruit: palpate study rupture-limits.",
    )
    return StudyReport(
        name="rupture",
        title="Stopping before rupture",
        provenance=provenance,
        tables=[
            _operating_table(rows, rows_unknown),
            rupture_told.table(told),
            _tradeoff_table(entries),
        ],
        payload={
            "study": "rupture",
            "provenance": list(provenance),
            "nominal_rate": nominal_rate,
            "rows": rows,
            "rows_fruit_unknown": rows_unknown,
            "summary": _summary(rows, known=True) + _summary(rows_unknown, known=False),
            "told_half_load": told,
            "tradeoff": entries,
        },
        figures={"rupture": lambda: _figure(entries)},
    )


def _guarded(
    splits: _Splits, *, known: bool, nominal_rate: float
) -> tuple[list[dict[str, Any]], list[Scored]]:
    """Return what our guard did on each fruit, told its kind or not, and its scores."""
    rows: list[dict[str, Any]] = []
    scores: list[Scored] = []
    for training, test in splits:
        model = learn(training, tell_apart=known)
        for closing in test:
            rows.append(_row(closing, model=model, known=known, nominal_rate=nominal_rate))
            scores.append(our_scores(closing, model=model, kind_known=known))
    return rows, scores


def _baseline_scores(splits: _Splits) -> dict[str, list[Scored]]:
    """Return the scores of what needs no curve, or no more than a line in the stiffness."""
    capped: list[Scored] = []
    ruled: list[Scored] = []
    for training, test in splits:
        of_fruit = {
            fruit: [c for c in training if c.fruit == fruit]
            for fruit in {c.fruit for c in training}
        }
        medians = {f: float(np.median([c.rupture_force_n for c in of_fruit[f]])) for f in of_fruit}
        lines = {fruit: fit_rule(of_fruit[fruit]) for fruit in of_fruit}
        for closing in test:
            if closing.fruit not in of_fruit:
                raise InputError(f"no {closing.fruit} to learn from, but {closing.grasp_id} is one")
            capped.append(cap_scores(closing, median_n=medians[closing.fruit]))
            ruled.append(rule_scores(closing, line=lines[closing.fruit]))
    return {"cap per fruit": capped, "stiffness rule": ruled}


def _row(
    closing: FruitClosing, *, model: DamageModel, known: bool, nominal_rate: float
) -> dict[str, Any]:
    stop_score = model.stop_score(nominal_rate=nominal_rate)
    kind = closing.fruit if known else ""
    limits = [model.limit(s, kind=kind, stop_score=stop_score) for s in closing.states]
    half = half_load(limits)
    stop_n = float(
        stop_forces(
            [Scored(closing.force_n, np.array([limit.score for limit in limits]))],
            rupture_force_n=[closing.rupture_force_n],
            at=np.array([stop_score]),
        )[0, 0]
    )
    return {
        "grasp_id": closing.grasp_id,
        "fruit": closing.fruit,
        "rupture_force_n": closing.rupture_force_n,
        "predicted_n": half and half.predicted_n,
        "low_n": half and half.low_n,
        "stop_force_n": stop_n,
        "ruptured": stop_n >= closing.rupture_force_n,
    }


def _summary(rows: Sequence[dict[str, Any]], *, known: bool) -> list[dict[str, Any]]:
    entries = []
    for fruit in [*sorted({row["fruit"] for row in rows}), "all"]:
        chosen = [row for row in rows if fruit in ("all", row["fruit"])]
        told = [row for row in chosen if row["predicted_n"] is not None]
        limits_n = np.array([row["rupture_force_n"] for row in chosen])
        error = [abs(row["predicted_n"] / row["rupture_force_n"] - 1) for row in told]
        above = [row["low_n"] <= row["rupture_force_n"] for row in told]
        share = np.array([row["stop_force_n"] for row in chosen]) / limits_n
        entries.append(
            {
                "fruit": fruit,
                "fruit_known": known,
                "grasps": len(chosen),
                "mean_abs_error_percent": 100 * float(np.mean(error)) if error else None,
                "above_low_bound": float(np.mean(above)) if above else None,
                "ruptured": int(sum(row["ruptured"] for row in chosen)),
                "mean_stop_share": float(share.mean()),
            }
        )
    return entries


def _operating_table(
    rows: Sequence[dict[str, Any]], rows_unknown: Sequence[dict[str, Any]]
) -> Table:
    return Table(
        title="Prediction at half load, and the guard as shipped",
        columns=(
            "fruit",
            "known to it",
            "grasps",
            "mean error, %",
            "rupture above low bound, %",
            "ruptured",
            "stop force / rupture force",
        ),
        rows=[
            (
                entry["fruit"],
                "yes" if entry["fruit_known"] else "no",
                str(entry["grasps"]),
                _number(entry["mean_abs_error_percent"]),
                _number(entry["above_low_bound"], scale=100),
                str(entry["ruptured"]),
                f"{entry['mean_stop_share']:.2f}",
            )
            for entry in _summary(rows, known=True) + _summary(rows_unknown, known=False)
        ],
    )


def _number(value: float | None, *, scale: float = 1.0) -> str:
    return "–" if value is None else f"{scale * value:.1f}"


def _tradeoff_table(entries: Sequence[dict[str, Any]]) -> Table:
    keys = list(dict.fromkeys((entry["fruit"], entry["method"]) for entry in entries))
    return Table(
        title="Firmness (mean stop force / rupture force) at a rupture rate of at most",
        columns=("fruit", "method", *(f"{rate:.0%}" for rate in RATES)),
        rows=[
            (
                fruit,
                method,
                *(
                    f"{entry['firmness']:.2f}"
                    for entry in entries
                    if (entry["fruit"], entry["method"]) == (fruit, method)
                ),
            )
            for fruit, method in keys
        ],
    )


def _figure(entries: Sequence[dict[str, Any]]) -> Figure:
    from palpate_studies.plots.rupture import tradeoff_figure

    return tradeoff_figure(entries)
