"""When to stop closing on a fruit: the limit of a grasp, a cap per fruit, a stiffness rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer

from palpate.errors import InputError
from palpate.estimate.damage import FOLDS, NOMINAL_RATE
from palpate.estimate.damage_learning import (
    FruitClosing,
    at_half_load,
    learn_damage,
    read_closings,
    split,
)
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rupture_ridge import learn_ridge
from palpate_studies.rupture_tradeoff import (
    RATES,
    Method,
    Policy,
    Scored,
    Scorer,
    Splits,
    applied,
    cap_scores,
    compare_grips,
    fit_rule,
    rule_scores,
    shipped_scores,
    stop_forces,
    tradeoff,
)
from palpate_studies.second.closings import other_closings

Learnt = TypeVar("Learnt")
CurvesOption = Annotated[Path | None, typer.Option(help="Closings until rupture.", metavar="CSV")]
IndexOption = Annotated[Path | None, typer.Option(help="Their rupture forces.", metavar="CSV")]


def report(
    *,
    curves: CurvesOption = None,
    index: IndexOption = None,
    test_curves: Annotated[
        Path | None, typer.Option(help="Closings to test on; without, 5 folds.", metavar="CSV")
    ] = None,
    test_index: Annotated[
        Path | None, typer.Option(help="Their rupture forces.", metavar="CSV")
    ] = None,
    second: SecondOption = False,
) -> StudyReport:
    """Stop closing on real fruit before it ruptures, at a nominal rate of rupture.

    Example: palpate study rupture --curves fruit.csv.gz --index fruit_index.csv
    """
    if (test_curves is None) != (test_index is None):
        raise InputError("--test-curves and --test-index go together; give both or neither")
    if second and curves is None and index is None:
        closings = other_closings()
    elif second or curves is None or index is None:
        raise InputError("give either --curves and --index or --second")
    else:
        closings = read_closings(curves, index)
    if test_curves is None or test_index is None:
        splits, how = split(closings), f"{FOLDS}-fold cross-validation"
    else:
        splits = [(closings, read_closings(test_curves, test_index))]
        how = f"learned from {index}, tested on {test_index}"
    tested = [closing for _, test in splits for closing in test]
    methods = [shipped(splits, known=known) for known in (True, False)]
    policies = [Policy("cap per fruit", _cap), RULE, Policy("ridge", learn_ridge)]
    methods += [applied(policy, splits) for policy in policies]
    entries, compared = tradeoff(methods, closings=tested), compare_grips(methods, tested)
    return StudyReport(
        name="rupture",
        title="Stopping before rupture",
        provenance=(
            (
                "Simulated (second generator): fruit with a skin, of foam and of dough, each kind "
                "of two ripenesses that rupture at a deformation of their own whatever the "
                "stiffness"
                if second
                else "Real recordings of fruit closed on until rupture"
            )
            + f"; {how}.",
            "`ours` is `DamageModel.bound_n`, the limit that a grasp obeys, at the nominal rate as "
            "it is; every sample used precedes the decision. Each other method's setting is chosen "
            "for the rate on the training fruit (a rank of scores by models fitted without each "
            "fruit); the rate that it then has on the tested fruit is next to it.",
            "Stiffness rule: a line per fruit fitted to the training fruit, with our stiffness. "
            "Ridge: force over rupture force from ten features of the curve so far; one for each "
            "fruit.",
        ),
        tables=[
            Table.wide(
                "Firmness (mean stop force / rupture force) and fruit ruptured, by nominal rate",
                [row | {"rate": f"{row['rate_limit']:.1%}"} for row in entries],
                {"fruit": "{fruit}", "method": "{method}"},
                over="rate",
                form="{firmness:.2f} ({ruptured} of {grasps})",
            ),
            Table.of(
                "Ours less each rival: grip lost, a rupture counted as all of it (90 % interval)",
                compared,
                ("rival", "rate_limit", "difference", "low", "high", "verdict"),
            ),
        ],
        payload={
            "study": "rupture",
            "second_generator": second,
            "nominal_rate": NOMINAL_RATE,
            "rows": [row for training, test in splits for row in _stopped(training, test=test)],
            "tradeoff": entries,
            "compared": compared,
        },
    )


command = as_command(report)


def _stopped(
    training: Sequence[FruitClosing], *, test: Sequence[FruitClosing]
) -> list[dict[str, Any]]:
    """Return what is predicted for each fruit at half load, and where its limit stops."""
    model = learn_damage(training)
    rows = []
    for one in test:
        half = at_half_load(one, model=model, kind=one.fruit)
        scores = shipped_scores(one, model=model, kind_known=True)
        rupture_n = one.rupture_force_n
        stop_n = float(
            stop_forces([scores], rupture_force_n=[rupture_n], at=np.array([NOMINAL_RATE]))[0, 0]
        )
        rows.append(
            {
                "grasp_id": one.grasp_id,
                "fruit": one.fruit,
                "rupture_force_n": rupture_n,
                "predicted_n": half and half.predicted_n,
                "low_n": half and half.low_n,
                "stop_force_n": stop_n,
                "ruptured": stop_n >= rupture_n,
            }
        )
    return rows


def shipped(splits: Splits, *, known: bool) -> Method:
    """Return the limit that a grasp obeys, at each nominal rate; nothing of it is calibrated."""
    scores = list[Scored]()
    for training, test in splits:
        model = learn_damage(training, by_kind=known)
        scores += [shipped_scores(one, model=model, kind_known=known) for one in test]
    name = "ours" if known else "ours, fruit unknown"
    return Method(name, scores, np.tile(RATES, (len(scores), 1)))


def _cap(training: Sequence[FruitClosing]) -> Scorer:
    medians = {
        fruit: float(np.median([closing.rupture_force_n for closing in of_fruit]))
        for fruit, of_fruit in _by_fruit(training).items()
    }
    return lambda closing: cap_scores(closing, median_n=_of_kind(medians, closing))


def _rule(training: Sequence[FruitClosing]) -> Scorer:
    lines = {fruit: fit_rule(of_fruit) for fruit, of_fruit in _by_fruit(training).items()}
    return lambda closing: rule_scores(closing, line=_of_kind(lines, closing))


RULE = Policy("stiffness rule", _rule)


def _by_fruit(closings: Sequence[FruitClosing]) -> dict[str, list[FruitClosing]]:
    fruits = dict.fromkeys(closing.fruit for closing in closings)
    return {fruit: [c for c in closings if c.fruit == fruit] for fruit in fruits}


def _of_kind(learned: Mapping[str, Learnt], closing: FruitClosing) -> Learnt:
    if closing.fruit not in learned:
        raise InputError(f"no {closing.fruit} to learn from, but {closing.grasp_id} is one")
    return learned[closing.fruit]
