"""What limits a rupture limit: learners given everything, tested on the fruit that our line is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.damage import FOLDS, LEAST_LOAD
from palpate.estimate.damage_learning import FruitClosing, copies, learn_damage, split
from palpate_studies.protocol.parts import Learned
from palpate_studies.report import SecondOption, StudyReport, as_command
from palpate_studies.rupture import CurvesOption, IndexOption, closings_of, grip_report, origin
from palpate_studies.rupture_learners import features, learned_scores, learners
from palpate_studies.rupture_policies import PUBLISHED, Scored, our_scores, published_scores
from palpate_studies.rupture_tradeoff import Method, Splits, settings_of, specimen


def report(
    *, curves: CurvesOption = None, index: IndexOption = None, second: SecondOption = False
) -> StudyReport:
    """Show how firm a grip may be by learners that are given all that a curve shows.

    Example: palpate study rupture-limits --curves fruit.csv.gz --index fruit_index.csv
    """
    every = closings_of(curves, index, second=second)
    copied = copies(every)
    return judge([c for c in every if c.grasp_id not in copied], second=second)


command = as_command(report)


def judge(closings: Sequence[FruitClosing], *, second: bool = False) -> StudyReport:
    """Put our line and the learners, tested on the same parts, into one report."""
    splits = split(closings)
    tested = [closing for _, test in splits for closing in test]
    shown = {closing.grasp_id: features(closing) for closing in closings}
    scores: dict[str, list[Scored]] = {"ours": []}
    for training, test in splits:
        model = learn_damage(training)
        scores["ours"] += [our_scores(closing, model=model) for closing in test]
    for name, make in learners().items():
        scores[name] = [
            scored
            for training, test in splits
            for scored in learned_scores(make, training=training, test=test, shown=shown)
        ]
    if all(closing.fruit in PUBLISHED for closing in tested):
        scores["rule as published"] = [published_scores(closing) for closing in tested]
    return grip_report(
        "rupture-limits",
        "What limits a rupture limit",
        [Method(name, each, _settings(each, splits)) for name, each in scores.items()],
        closings=tested,
        provenance=(
            f"{origin(second=second)}, copies left out; {FOLDS}-fold.",
            "Learners are given all of each curve that came before: stiffness over several "
            "stretches, bend, roughness, force lost on the way, sampling, size, force; one is "
            "trained for each fruit. They show what the curves hold, and are no part of palpate.",
            "Settings of the grip are chosen for each part on the scores of the other parts' "
            "fruit, by models fitted without them.",
        ),
        second=second,
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
