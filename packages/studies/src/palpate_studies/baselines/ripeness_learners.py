"""Untuned learners of a fruit's stage from all grasps up to a day.

The training set is the labelled fruit of palpate, of all given sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate_station.ripeness.firmness import DayFirmness

#: Learner -> description.
STAGE_LEARNERS = {
    "logistic": "logistic regression on all grasps up to that day",
    "trees": "boosted trees on all grasps up to that day",
}


def list_day_inputs(days: Sequence[DayFirmness]) -> list[float]:
    """Return the inputs of a learner from the days so far.

    The inputs are firmness and scatter of the last day, firmness of the first and of the previous
    day, days since the first, change since the previous day, slope since the first, mean firmness,
    and number of days. The number of grasps is not an input, because labelled fruit has ten a day
    and judged fruit 3 to 30.

    Examples
    --------
    >>> days = [DayFirmness(day=float(d), firmness=2.0 - d, grasps=3, spread=0.1) for d in range(3)]
    >>> list_day_inputs(days)
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
    """Train a learner of stages (as numbers) on rows of labelled days.

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
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    make: dict[str, Callable[[], Any]] = {
        "logistic": lambda: make_pipeline(StandardScaler(), LogisticRegression(max_iter=2000)),
        # Smaller leaves than the default, because a hundred labelled days are few.
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
