"""Untuned learners of a fruit's stage, from all grasps up to the day.

They learn from the same labelled fruits as ours, of all sensors that are given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import require_extra
from palpate.produce.ripeness.firmness import DayFelt

#: Learner -> what it is, and the numbers of a day.
STAGE_LEARNERS = {
    "logistic": "logistic regression on all grasps up to that day",
    "trees": "boosted trees on all grasps up to that day",
}


def numbers_of(days: Sequence[DayFelt]) -> list[float]:
    """Return what the days up to the last show.

    That day's firmness and scatter, the first day's firmness and the day before's, how long ago
    and how fast it fell, the mean, and how many days there are. Not how many grasps: labelled
    fruit has ten a day and judged fruit from 3 to 30, which misleads what learns from it.

    Examples
    --------
    >>> felt = [DayFelt(day=float(d), firmness=2.0 - d, grasps=3, spread=0.1) for d in range(3)]
    >>> numbers_of(felt)
    [0.0, 0.1, 2.0, 1.0, 2.0, -1.0, -1.0, 1.0, 3.0]
    """
    first, last, before = days[0], days[-1], days[max(len(days) - 2, 0)]
    since = last.day - first.day
    return [
        last.firmness,
        float(np.nan_to_num(last.spread)),
        first.firmness,
        before.firmness,
        since,
        last.firmness - before.firmness,
        (last.firmness - first.firmness) / since if since else 0.0,
        float(np.mean([day.firmness for day in days])),
        float(len(days)),
    ]


def learn_stage(
    learner: str, rows: Sequence[Sequence[float]], stages: Sequence[int]
) -> Callable[[Sequence[float]], int]:
    """Learn stages, as numbers, from rows of labelled days.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.

    Examples
    --------
    >>> rows = [[float(x), 0.0] for x in range(40)]
    >>> stage = learn_stage("trees", rows, [int(x >= 20) for x in range(40)])
    >>> stage([3.0, 0.0]), stage([33.0, 0.0])
    (0, 1)
    """
    with require_extra("a rival that learns", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingClassifier
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
    make: dict[str, Callable[[], Any]] = {
        "logistic": lambda: make_pipeline(StandardScaler(), LogisticRegression(max_iter=2000)),
        # Smaller leaves than usual: a hundred labelled days are few.
        "trees": lambda: HistGradientBoostingClassifier(
            max_iter=100,
            learning_rate=0.1,
            max_leaf_nodes=15,
            min_samples_leaf=5,
            random_state=0,
        ),
    }
    model = make[learner]().fit(_rows(rows), list(stages))
    return lambda row: int(model.predict(_rows([row]))[0])


def _rows(rows: Sequence[Sequence[float]]) -> FloatArray:
    return np.array(rows, dtype=float)
