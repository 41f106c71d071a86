"""What limits a rupture limit: learners given everything, tested on the fruit that our line is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.commands.options import JsonOption
from palpate.estimate.damage import FOLDS, LEAST_LOAD
from palpate.estimate.damage_learning import (
    FruitClosing,
    at_half_load,
    copies,
    learn_damage,
    split,
)
from palpate_studies.protocol.parts import Learned
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.rupture import (
    CurvesOption,
    IndexOption,
    SecondOption,
    closings_of,
    compare,
    origin,
)
from palpate_studies.rupture_learners import features, learned_scores, learners
from palpate_studies.rupture_policies import Scored, our_scores
from palpate_studies.rupture_published import PUBLISHED, published_scores
from palpate_studies.rupture_told import told_half_load
from palpate_studies.rupture_tradeoff import (
    RATES,
    Method,
    Splits,
    settings_of,
    specimen,
    tradeoff,
)

_OURS, _PUBLISHED = "ours", "rule as published"
#: How much firmer than the published rule a grip would have to be to be worth a fifth more.
_FIFTH = 1.2


def command(
    curves: CurvesOption = None,
    index: IndexOption = None,
    second: SecondOption = False,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Show what limits the prediction of a rupture, and how firm a grip may be.

    Example: palpate study rupture-limits --curves fruit.csv.gz --index fruit_index.csv
    """
    closings = closings_of(curves, index, second=second)
    copied = copies(closings)
    kept = [c for c in closings if c.grasp_id not in copied]
    report(kept, second=second).emit(as_json=as_json, out=out)


def report(closings: Sequence[FruitClosing], *, second: bool = False) -> StudyReport:
    """Put our line and the learners, tested on the same parts, into one report."""
    splits = split(closings)
    tested = [closing for _, test in splits for closing in test]
    shown = {closing.grasp_id: features(closing) for closing in closings}
    scores: dict[str, list[Scored]] = {}
    errors: dict[str, dict[str, float]] = {_OURS: _our_errors(splits)}
    errors[f"{_OURS}, whole stretches of the file left out"] = _our_errors(_stretches(closings))
    for training, test in splits:
        model = learn_damage(training)
        scores.setdefault(_OURS, []).extend(
            our_scores(closing, model=model, kind_known=True) for closing in test
        )
    for name, make in learners().items():
        for training, test in splits:
            scores.setdefault(name, []).extend(
                learned_scores(make, training=training, test=test, shown=shown)
            )
        errors[name] = _by_fruit(tested, map(_missed, tested, scores[name]))
    errors["a line told the true half load"] = {
        entry["fruit"]: entry["mean_abs_error_percent"] for entry in told_half_load(splits)
    }
    if all(closing.fruit in PUBLISHED for closing in tested):
        scores[_PUBLISHED] = [published_scores(closing) for closing in tested]
        errors[f"{_PUBLISHED}, told the true half load"] = _by_fruit(
            tested, map(_missed_at_true_half, tested, scores[_PUBLISHED])
        )
    methods = [Method(name, each, _settings(each, splits)) for name, each in scores.items()]
    entries = tradeoff(methods, closings=tested)
    provenance = (
        f"{origin(second=second)}, copies left out; {FOLDS}-fold.",
        "Learners are given all of each curve that came before: stiffness over several stretches, "
        "bend, roughness, force lost on the way, sampling, size, force; one is trained for each "
        "fruit. They show what the curves hold, and are no part of palpate.",
        "Settings of the grip are chosen for each part on the scores of the other parts' fruit, by "
        "models fitted without them.",
        "Stretches: a fifth of each fruit's closings, neighbours in the file, left out together.",
    )
    return StudyReport(
        name="rupture-limits",
        title="What limits a rupture limit",
        provenance=provenance,
        tables=[_error_table(errors), _firmness_table(entries)],
        payload={
            "study": "rupture-limits",
            "second_generator": second,
            "provenance": list(provenance),
            "mean_abs_error_percent": errors,
            "tradeoff": entries,
            "compared": compare(methods, closings=tested),
        },
    )


def _settings(scored: Sequence[Scored], splits: Splits) -> NDArray[np.float64]:
    """Return settings for each fruit, shape (fruits, rates), from the scores of other parts."""
    critical = np.array([max(one.score.tolist(), default=LEAST_LOAD) for one in scored])
    part = np.repeat(np.arange(len(splits)), [len(test) for _, test in splits])
    names = np.array([specimen(closing) for _, test in splits for closing in test])
    chosen = [
        Learned(found=settings_of(critical[part != k]), seen=frozenset(names[part != k].tolist()))
        for k in range(len(splits))
    ]
    return np.array([chosen[k].on([name]) for k, name in zip(part, names.tolist(), strict=True)])


def _stretches(closings: Sequence[FruitClosing]) -> Splits:
    """Return parts of neighbours in the file: if days or batches differ, these differ most."""
    of_fruit: dict[str, list[str]] = {}
    for closing in closings:
        of_fruit.setdefault(closing.fruit, []).append(closing.grasp_id)
    part = {
        name: place * FOLDS // len(names)
        for names in of_fruit.values()
        for place, name in enumerate(names)
    }
    return [
        (
            [c for c in closings if part[c.grasp_id] != k],
            [c for c in closings if part[c.grasp_id] == k],
        )
        for k in range(FOLDS)
    ]


def _our_errors(splits: Splits) -> dict[str, float]:
    tested, missed = list[FruitClosing](), list[float]()
    for training, test in splits:
        model = learn_damage(training)
        for closing in test:
            limit = at_half_load(closing, model=model, kind=closing.fruit)
            tested.append(closing)
            missed.append(
                np.nan if limit is None else abs(limit.predicted_n / closing.rupture_force_n - 1)
            )
    return _by_fruit(tested, missed)


def _missed(closing: FruitClosing, scored: Scored) -> float:
    """Return the error where the force first reaches half of what is predicted at that moment."""
    if not scored.score.size:
        return np.nan
    reached = np.flatnonzero(scored.score >= 0.5)
    return _missed_at(closing, scored, int(reached[0]) if reached.size else -1)


def _missed_at_true_half(closing: FruitClosing, scored: Scored) -> float:
    reached = np.flatnonzero(scored.force_n >= closing.rupture_force_n / 2)
    return _missed_at(closing, scored, int(reached[0])) if reached.size else np.nan


def _missed_at(closing: FruitClosing, scored: Scored, place: int) -> float:
    # It has borne this force already.
    predicted_n = scored.force_n[place] / min(float(scored.score[place]), 1.0)
    return abs(float(predicted_n) / closing.rupture_force_n - 1)


def _by_fruit(tested: Sequence[FruitClosing], missed: Iterable[float]) -> dict[str, float]:
    found: dict[str, list[float]] = {}
    for closing, error in zip(tested, missed, strict=True):
        found.setdefault(closing.fruit, []).append(error)
    return {fruit: 100 * float(np.nanmean(found[fruit])) for fruit in sorted(found)}


def _error_table(errors: dict[str, dict[str, float]]) -> Table:
    fruits = sorted(errors[_OURS])
    return Table(
        title="Mean error of the predicted rupture force at half load, %",
        columns=("method", *fruits),
        rows=[
            (name, *(f"{found[fruit]:.1f}" if fruit in found else "–" for fruit in fruits))
            for name, found in errors.items()
        ],
    )


def _firmness_table(entries: Sequence[dict[str, Any]]) -> Table:
    rows = []
    for fruit, method in dict.fromkeys((entry["fruit"], entry["method"]) for entry in entries):
        firm = [e["firmness"] for e in entries if (e["fruit"], e["method"]) == (fruit, method)]
        rows.append((fruit, method, *(f"{one:.2f}" for one in firm)))
        if method == _PUBLISHED:
            rows.append(
                (fruit, "a fifth firmer than that", *(f"{_FIFTH * one:.2f}" for one in firm))
            )
    return Table(
        title="Firmness (mean stop force / rupture force) at a nominal rate of rupture",
        columns=("fruit", "method", *(f"{rate:.0%}" for rate in RATES)),
        rows=rows,
    )
