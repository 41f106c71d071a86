"""When to stop closing on a fruit: the limit of a grasp, a cap per fruit, a stiffness rule."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer

from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate.estimate.damage import FOLDS, NOMINAL_RATE, DamageModel, half_load
from palpate.estimate.damage_learning import FruitClosing, learn_damage, read_closings, split
from palpate_studies import rupture_told
from palpate_studies.other_closings import other_closings
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.rupture_policies import (
    Scored,
    cap_scores,
    fit_rule,
    our_scores,
    rule_scores,
    shipped_scores,
    stop_forces,
)
from palpate_studies.rupture_published import PUBLISHED, published_scores
from palpate_studies.rupture_tradeoff import (
    RATES,
    Method,
    Policy,
    Scorer,
    Splits,
    applied,
    specimen,
    stops,
    tradeoff,
)

Learnt = TypeVar("Learnt")

CurvesOption = Annotated[Path | None, typer.Option(help="Closings until rupture.", metavar="CSV")]
IndexOption = Annotated[Path | None, typer.Option(help="Their rupture forces.", metavar="CSV")]
SecondOption = Annotated[
    bool,
    typer.Option(
        "--second", help="Simulated fruit of two ripenesses that rupture at a deformation."
    ),
]


def command(
    curves: CurvesOption = None,
    index: IndexOption = None,
    test_curves: Annotated[
        Path | None, typer.Option(help="Closings to test on; without, 5 folds.", metavar="CSV")
    ] = None,
    test_index: Annotated[
        Path | None, typer.Option(help="Their rupture forces.", metavar="CSV")
    ] = None,
    nominal_rate: Annotated[
        float, typer.Option(help="Share of fruit that the guard may let rupture.")
    ] = NOMINAL_RATE,
    second: SecondOption = False,
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
    closings = closings_of(curves, index, second=second)
    if test_curves is None or test_index is None:
        splits = split(closings)
        how = f"{FOLDS}-fold cross-validation"
    else:
        splits = [(closings, read_closings(test_curves, test_index))]
        how = f"learned from {index}, tested on {test_index}"
    report = _report(splits, how=how, nominal_rate=nominal_rate, second=second)
    report.emit(as_json=as_json, out=out)


def closings_of(curves: Path | None, index: Path | None, *, second: bool) -> list[FruitClosing]:
    """Return the closings of two files, or those of the second generator.

    Raises
    ------
    InputError
        If neither or both are asked for.
    """
    if second and curves is None and index is None:
        return other_closings()
    if second or curves is None or index is None:
        raise InputError("give either --curves and --index or --second")
    return read_closings(curves, index)


def origin(*, second: bool) -> str:
    """Return what the closings are, for a report."""
    if not second:
        return "Real recordings of fruit closed on until rupture"
    return (
        "Simulated (second generator): fruit with a skin, of foam and of dough, each kind of two "
        "ripenesses that rupture at a deformation of their own whatever the stiffness"
    )


def _report(splits: Splits, *, how: str, nominal_rate: float, second: bool) -> StudyReport:
    rows = _guarded(splits, known=True, nominal_rate=nominal_rate)
    rows_unknown = _guarded(splits, known=False, nominal_rate=nominal_rate)
    tested = [closing for _, test in splits for closing in test]
    methods = [shipped(splits, known=known) for known in (True, False)]
    methods += [applied(policy, splits) for policy in _policies(splits)]
    entries = tradeoff(methods, closings=tested)
    compared = compare(methods, closings=tested)
    given = rupture_told.told_half_load(splits)
    provenance = (
        f"{origin(second=second)}; {how}.",
        f"`ours` is `DamageModel.bound_n`, the limit that a grasp obeys, at a nominal rupture rate "
        f"of {nominal_rate:.1%}; every sample used precedes the decision.",
        "Trade-off: `ours` takes the nominal rate as it is; each other method's setting is chosen "
        "for it on the training fruit (a rank of scores by models fitted without each fruit); "
        "the rate that it then has on the tested fruit stands next to it.",
        "Stiffness rule: a line per fruit fitted to the training fruit, with our stiffness. Rule "
        "as published: with its authors' constants and window; they fitted them to fruit that may "
        "be among these.",
        "What learners that are given everything do on such fruit: palpate study rupture-limits.",
    )
    return StudyReport(
        name="rupture",
        title="Stopping before rupture",
        provenance=provenance,
        tables=[
            _operating_table(rows, rows_unknown),
            rupture_told.table(given),
            _tradeoff_table(entries),
            _compared_table(compared),
        ],
        payload={
            "study": "rupture",
            "second_generator": second,
            "provenance": list(provenance),
            "nominal_rate": nominal_rate,
            "rows": rows,
            "rows_fruit_unknown": rows_unknown,
            "summary": _summary(rows, known=True) + _summary(rows_unknown, known=False),
            "told_half_load": given,
            "tradeoff": entries,
            "compared": compared,
        },
    )


def _guarded(splits: Splits, *, known: bool, nominal_rate: float) -> list[dict[str, Any]]:
    """Return where the limit stopped on each fruit, given its kind or not."""
    rows: list[dict[str, Any]] = []
    for training, test in splits:
        model = learn_damage(training, by_kind=known)
        rows += [
            _row(closing, model=model, known=known, nominal_rate=nominal_rate) for closing in test
        ]
    return rows


def compare(methods: Sequence[Method], *, closings: Sequence[FruitClosing]) -> list[dict[str, Any]]:
    """Return ours against every rival at each nominal rate, paired by fruit.

    The loss of a fruit is what the grip falls short of its rupture force, as a share, and 1 where
    it ruptured: a firm grip that ruptures gains nothing.
    """
    lost = {
        method.name: np.where(found >= 1, 1.0, 1.0 - found)
        for method in methods
        for found in [stops(method, closings)]
    }
    ours, *rivals = lost
    names = [specimen(closing) for closing in closings]
    return [
        {
            "rival": rival,
            "rate_limit": rate,
            **paired_difference(
                lost[ours][:, column], lost[rival][:, column], names, statistic=np.mean
            ).to_dict(),
        }
        for rival in rivals
        for column, rate in enumerate(RATES)
    ]


def _policies(splits: Splits) -> list[Policy]:
    """Return what the limit of a grasp has to beat."""
    found = [
        Policy("load quantile", _ours(known=True)),
        Policy("cap per fruit", _cap),
        Policy("stiffness rule", _rule),
    ]
    if all(closing.fruit in PUBLISHED for _, test in splits for closing in test):
        found.append(Policy("rule as published", lambda training: published_scores))
    return found


def shipped(splits: Splits, *, known: bool) -> Method:
    """Return the limit that a grasp obeys, at each nominal rate; nothing of it is calibrated."""
    scores = list[Scored]()
    for training, test in splits:
        model = learn_damage(training, by_kind=known)
        scores += [shipped_scores(one, model=model, kind_known=known) for one in test]
    name = "ours" if known else "ours, fruit unknown"
    return Method(name, scores, np.tile(RATES, (len(scores), 1)))


def _ours(*, known: bool) -> Callable[[Sequence[FruitClosing]], Scorer]:
    def learned(training: Sequence[FruitClosing]) -> Scorer:
        return partial(our_scores, model=learn_damage(training, by_kind=known), kind_known=known)

    return learned


def _cap(training: Sequence[FruitClosing]) -> Scorer:
    medians = {
        fruit: float(np.median([closing.rupture_force_n for closing in of_fruit]))
        for fruit, of_fruit in _by_fruit(training).items()
    }
    return lambda closing: cap_scores(closing, median_n=_of_kind(medians, closing))


def _rule(training: Sequence[FruitClosing]) -> Scorer:
    lines = {fruit: fit_rule(of_fruit) for fruit, of_fruit in _by_fruit(training).items()}
    return lambda closing: rule_scores(closing, line=_of_kind(lines, closing))


def _by_fruit(closings: Sequence[FruitClosing]) -> dict[str, list[FruitClosing]]:
    fruits = dict.fromkeys(closing.fruit for closing in closings)
    return {fruit: [c for c in closings if c.fruit == fruit] for fruit in fruits}


def _of_kind(learned: Mapping[str, Learnt], closing: FruitClosing) -> Learnt:
    if closing.fruit not in learned:
        raise InputError(f"no {closing.fruit} to learn from, but {closing.grasp_id} is one")
    return learned[closing.fruit]


def _row(
    closing: FruitClosing, *, model: DamageModel, known: bool, nominal_rate: float
) -> dict[str, Any]:
    kind = closing.fruit if known else ""
    half = half_load([model.limit(s, kind=kind, stop_score=np.inf) for s in closing.states])
    stop_n = float(
        stop_forces(
            [shipped_scores(closing, model=model, kind_known=known)],
            rupture_force_n=[closing.rupture_force_n],
            at=np.array([nominal_rate]),
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
        predicted = [row for row in chosen if row["predicted_n"] is not None]
        limits_n = np.array([row["rupture_force_n"] for row in chosen])
        error = [abs(row["predicted_n"] / row["rupture_force_n"] - 1) for row in predicted]
        above = [row["low_n"] <= row["rupture_force_n"] for row in predicted]
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
        title="Prediction at half load, and the limit as shipped",
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
        title="Firmness (mean stop force / rupture force) and fruit ruptured, by nominal rate",
        columns=("fruit", "method", *(f"{rate:.1%}" for rate in RATES)),
        rows=[
            (
                fruit,
                method,
                *(
                    f"{entry['firmness']:.2f} ({entry['ruptured']} of {entry['grasps']})"
                    for entry in entries
                    if (entry["fruit"], entry["method"]) == (fruit, method)
                ),
            )
            for fruit, method in keys
        ],
    )


def _compared_table(compared: Sequence[dict[str, Any]]) -> Table:
    return Table(
        title="Ours less each rival: grip lost, a rupture counted as all of it (90 % interval)",
        columns=("rival", "nominal rate", "difference", "who loses less"),
        rows=[
            (
                row["rival"],
                f"{row['rate_limit']:.1%}",
                f"{row['difference']:+.3f} ({row['low']:+.3f} to {row['high']:+.3f})",
                row["verdict"],
            )
            for row in compared
        ],
    )
