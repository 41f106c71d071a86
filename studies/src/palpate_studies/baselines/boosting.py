"""Gradient boosting given everything: the same features as the ridge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.errors import needing
from palpate_studies.baselines.ridge import features
from palpate_studies.protocol.method import Answer, Case, Question, log_error

#: Trees tried on the choosing part.
_TREES = (10, 30, 100, 300)


class Boosting:
    """Boosted trees for ln(answer / scale), their number chosen on the choosing part."""

    name = "boosted trees, told everything"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Fit on the training part with each number, keep the best, and refit on both.

        Raises
        ------
        MissingExtraError
            If scikit-learn is not installed.
        """

        def loss(trees: int) -> float:
            answer = _fitted(training, trees)
            return float(np.median([log_error(answer(c.question), c.truth) for c in choosing]))

        return _fitted([*training, *choosing], min(_TREES, key=loss))


def _fitted(cases: Sequence[Case], trees: int) -> Answer:
    with needing("boosted trees", extra="produce"):
        from sklearn.ensemble import GradientBoostingRegressor
    kinds = sorted({case.question.kind for case in cases})
    model = GradientBoostingRegressor(
        n_estimators=trees, max_depth=3, learning_rate=0.05, subsample=0.7, random_state=0
    ).fit(
        [features(case.question, kinds) for case in cases],
        [np.log(case.truth / case.question.scale) for case in cases],
    )

    def answer(asked: Question) -> float:
        return float(asked.scale * np.exp(model.predict([features(asked, kinds)])[0]))

    return answer
