"""Ridge regression given everything: the curve at eight places, the question and the kind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate_studies.protocol.method import Answer, Case, Question, log_error

#: Places along the curve, as shares of its last abscissa; penalties tried on the choosing part.
_PLACES = np.linspace(0.0, 1.0, 8)
_PENALTIES = (1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0)


class Ridge:
    """A line in ln(answer / scale), its penalty chosen on the choosing part."""

    name = "ridge, told everything"

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Fit on the training part with each penalty, keep the best, and refit on both."""

        def loss(penalty: float) -> float:
            answer = _fitted(training, penalty)
            return float(np.median([log_error(answer(c.question), c.truth) for c in choosing]))

        return _fitted([*training, *choosing], min(_PENALTIES, key=loss))


def features(asked: Question, kinds: Sequence[str]) -> FloatArray:
    """Return numbers without a unit: the readings over the last, the abscissas, the kind."""
    x, y = asked.curve.T
    at = np.interp(x[0] + _PLACES * np.ptp(x), x, y) if np.all(np.diff(x) >= 0) else y[[0, -1]]
    at = np.resize(at, _PLACES.size)
    return np.concatenate(
        [
            at / y[-1],
            [np.log(abs(asked.asked) + 1e-9), np.log(np.ptp(x) + 1e-9), np.log(asked.scale)],
            [float(asked.kind == kind) for kind in kinds],
        ]
    )


def _fitted(cases: Sequence[Case], penalty: float) -> Answer:
    kinds = sorted({case.question.kind for case in cases})
    rows = np.array([features(case.question, kinds) for case in cases])
    mean, sd = rows.mean(axis=0), rows.std(axis=0) + 1e-9
    target = np.array([np.log(case.truth / case.question.scale) for case in cases])
    design = (rows - mean) / sd
    middle = float(target.mean())
    weights = np.linalg.solve(
        design.T @ design + penalty * len(cases) * np.eye(design.shape[1]),
        design.T @ (target - middle),
    )

    def answer(asked: Question) -> float:
        log = middle + (features(asked, kinds) - mean) / sd @ weights
        return float(asked.scale * np.exp(np.clip(log, target.min() - 1, target.max() + 1)))

    return answer
